"""Settings of the server. Options of the command line override the environment.

Each is read from FOREWARN_NAME; the guide describes them (several-people.md).
"""

import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from ipaddress import ip_address, ip_network
from pathlib import Path
from typing import Any, get_type_hints

PREFIX = "FOREWARN_"
SHORTEST_TOKEN = 16
SHARED = re.compile(r"http://[^/?#@\s:]+:\d{1,5}|http://\[[0-9A-Fa-f:.]+\]:\d{1,5}")
ORIGIN = re.compile(r"https?://(\[[0-9a-f:.]+\]|[0-9a-z._-]+)(:[0-9]{1,5})?")


class SettingsError(ValueError):
    """An invalid setting."""


def default_data_dir() -> Path:
    from platformdirs import user_data_path

    return user_data_path("forewarn", appauthor=False)


@dataclass(frozen=True)
class Settings:
    """Address, data and limits of the server.

    Sizes in bytes. SettingsError for an address that other machines can reach without a token, for
    a short token, and for numbers out of range.
    """

    data_dir: Path = field(default_factory=default_data_dir)
    host: str = "127.0.0.1"
    port: int = 8000
    token: str | None = field(default=None, repr=False)
    database_url: str | None = field(default=None, repr=False)
    allowed_hosts: tuple[str, ...] = ()
    allowed_origins: tuple[str, ...] = ()
    max_flights: int = 64
    max_jobs: int = 1
    max_queued_jobs: int = 20
    max_body_bytes: int = 32 * 2**20
    max_upload_bytes: int = 4 * 2**30
    max_array_bytes: int = 4 * 2**30
    max_header_bytes: int = 64 * 2**10
    header_seconds: float = 10.0
    body_seconds: float = 30.0
    idle_seconds: float = 5.0
    session_seconds: float = 12 * 3600.0
    udp_senders: tuple[str, ...] = ()
    udp_key: str | None = field(default=None, repr=False)
    retain_days: float = 0.0
    retain_gb: float = 0.0
    scheduler: str | None = None
    shared: str | None = None
    archives: tuple[str, ...] = ()
    real_time: bool = False

    def __post_init__(self) -> None:
        if self.token is not None and len(self.token) < SHORTEST_TOKEN:
            raise SettingsError(
                f"the token has {len(self.token)} characters: give at least {SHORTEST_TOKEN}, for "
                "example from `openssl rand -hex 16`"
            )
        if self.token is not None and not (self.token.isascii() and self.token.isprintable()):
            raise SettingsError("the token has characters not allowed in a header: use ASCII")
        if self.udp_key is not None and len(self.udp_key) < SHORTEST_TOKEN:
            raise SettingsError(
                f"udp_key has {len(self.udp_key)} characters: give at least {SHORTEST_TOKEN}"
            )
        for sender in self.udp_senders:
            try:
                ip_network(sender, strict=False)
            except ValueError:
                raise SettingsError(
                    f"udp_senders has {sender!r}: give an address or network such as 10.0.0.0/24"
                ) from None
        for origin in self.allowed_origins:
            if not ORIGIN.fullmatch(origin):
                raise SettingsError(
                    f"allowed_origins has {origin!r}: give scheme, host and port, as a browser "
                    "sends them, such as https://openmct.range:8080"
                )
        if not is_loopback(self.host) and self.token is None:
            raise SettingsError(
                f"host {self.host} can be reached from other machines: set FOREWARN_TOKEN, or "
                "listen on 127.0.0.1"
            )
        if self.shared is not None and not SHARED.fullmatch(self.shared):
            raise SettingsError(
                f"shared={self.shared!r}: give the address at which the other servers reach this "
                "one, with its port, such as http://range-1:8000"
            )
        if not 0 <= self.port <= 65535:
            raise SettingsError(f"port={self.port}: give a number between 0 and 65535")
        for name, value in vars(self).items():
            least = 1024 if name.endswith("_bytes") else 0
            if isinstance(value, int | float) and not least <= value < math.inf:
                raise SettingsError(f"{name}={value}: give {least} or more")
            if name.endswith("_seconds") and not value:
                raise SettingsError(f"{name}={value}: give a positive number")

    @property
    def url(self) -> str:
        return self.database_url or f"sqlite:///{self.data_dir / 'forewarn.db'}"

    @property
    def is_local(self) -> bool:
        return is_loopback(self.host)


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach this name or address."""
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def read_settings(environment: Mapping[str, str] | None = None, **options: Any) -> Settings:
    """Settings from the environment, overridden by options that are not None.

    SettingsError for a variable that is unknown or has a value of the wrong type.
    """
    environment = os.environ if environment is None else environment
    known = {PREFIX + entry.name.upper(): entry for entry in fields(Settings)}
    values: dict[str, Any] = {}
    for name, text in environment.items():
        if not name.startswith(PREFIX) or not text:
            continue
        if name not in known:
            raise SettingsError(f"{name} is not a setting: choose {', '.join(known)}")
        values[known[name].name] = _parse(name, known[name].name, text)
    return Settings(**values | {key: value for key, value in options.items() if value is not None})


def _parse(variable: str, name: str, text: str) -> Any:
    kind = get_type_hints(Settings)[name]
    if kind is Path:
        return Path(text).expanduser()
    if kind == tuple[str, ...]:
        return tuple(part.strip() for part in text.split(",") if part.strip())
    if kind is bool:
        if text not in ("0", "1"):
            raise SettingsError(f"{variable}={text!r}: give 0 or 1")
        return text == "1"
    if kind not in (int, float):
        return text
    try:
        return kind(text)
    except ValueError:
        needed = "an integer" if kind is int else "a number"
        raise SettingsError(f"{variable}={text!r}: give {needed}") from None
