"""`forewarn token`: create, list and revoke tokens in the database. The server may run."""

import argparse
import getpass
from contextlib import closing
from dataclasses import asdict

from app.commands.options.option import add_json, add_place, option, place_of
from app.commands.output.results import print_result
from app.settings import Settings
from app.store.people import LINK_SECONDS, LOCAL, ROLES, AuditEntry, StoredToken
from app.store.store import Store, open_store
from app.store.tables import now

TOKENS = "/api/v1/tokens"


def add(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(required=True, metavar="ACTION", dest="action")
    create = actions.add_parser("create", help="create a token; it is printed only once")
    option(create, "--role", "what the person may do", choices=ROLES, required=True)
    option(create, "--days DAYS", "days until it expires; never if absent", type=float)
    listing = actions.add_parser("list", help="list the tokens with names and roles")
    revoke = actions.add_parser("revoke", help="revoke a person's token and close the sessions")
    link = actions.add_parser("link", help="create an address that logs the person in once")
    option(link, "--address ADDRESS", "address of the server for the person's browser")
    for action in (create, revoke, link):
        option(action, "name", "name of the person")
    for action in (create, listing, revoke, link):
        add_place(action)
        add_json(action)


def run(options: argparse.Namespace) -> int:
    settings = place_of(options)
    try:
        with closing(open_store(settings.url, recover=False)) as store:
            ACTIONS[options.action](options, store, settings)
    except LookupError as error:
        raise ValueError(error.args[0]) from error
    return 0


def _create(options: argparse.Namespace, store: Store, settings: Settings) -> None:
    made, secret = store.tokens.add(options.name, options.role, options.days)
    _log(store, "POST", TOKENS, 201)
    text = f"{_line(made)}\ntoken, not shown again: {secret}"
    print_result(options, text, asdict(made) | {"token": secret})


def _list(options: argparse.Namespace, store: Store, settings: Settings) -> None:
    listed = store.tokens.all()
    text = "\n".join(map(_line, listed)) or "no tokens"
    print_result(options, text, [asdict(token) for token in listed])


def _revoke(options: argparse.Namespace, store: Store, settings: Settings) -> None:
    revoked = store.tokens.revoke(store.tokens.of_name(options.name).id)
    _log(store, "DELETE", f"{TOKENS}/{revoked.id}", 200)
    print_result(options, _line(revoked), asdict(revoked))


def _link(options: argparse.Namespace, store: Store, settings: Settings) -> None:
    token = store.tokens.of_name(options.name)
    code = store.tokens.make_link(token.id)
    _log(store, "POST", f"{TOKENS}/{token.id}/link", 200)
    address = (options.address or f"http://127.0.0.1:{settings.port}").rstrip("/")
    link = f"{address}/login?link={code}"
    text = f"logs {options.name} in once, within {LINK_SECONDS / 60:.0f} minutes: {link}"
    print_result(options, text, {"link": link, "seconds": LINK_SECONDS})


def _log(store: Store, method: str, path: str, status: int) -> None:
    """Log a change as the equivalent request; the address names the operating system's user."""
    address = f"command line of {getpass.getuser()}"
    store.audit.add([AuditEntry(now(), LOCAL, "admin", address, method, path, status)])


def _line(token: StoredToken) -> str:
    """A token in one line: name, role, validity, last use."""
    if token.revoked is not None:
        state = f"revoked {_minute(token.revoked)}"
    elif token.expires is None:
        state = "does not expire"
    else:
        state = f"{'expires' if token.is_valid else 'expired'} {_minute(token.expires)}"
    used = "never used" if token.last_used is None else f"last used {_minute(token.last_used)}"
    return f"{token.name}  {token.role}  {state}  {used}"


def _minute(time: str) -> str:
    return f"{time[:10]} {time[11:16]} UTC"


ACTIONS = {"create": _create, "list": _list, "revoke": _revoke, "link": _link}
