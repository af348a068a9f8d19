import asyncio
import threading

import numba
import pytest

from app.jobs.jobs import Jobs, NotRunning, QueueFull
from app.routes.jobs import accepted
from app.store.store import NotFound, open_store
from tests.support.patience import PATIENCE


class Gate:
    """Work that says where it is and goes on when told."""

    def __init__(self):
        self.begun, self.go_on = threading.Event(), threading.Event()

    def __call__(self, task):
        task.progress("first half", 0, 2)
        self.begun.set()
        assert self.go_on.wait(PATIENCE)
        task.progress("second half", 1, 2)
        return {"answer": 42}


@pytest.fixture
def store(tmp_path):
    store = open_store(tmp_path / "forewarn.db")
    yield store
    store.close()


@pytest.fixture
def jobs(store):
    jobs = Jobs(store, workers=1, queue=2)
    yield jobs
    jobs.close()


def watched(jobs, job_id):
    """Every change of a job until it ends."""

    async def watch():
        return [info async for info in jobs.watch(job_id, PATIENCE) if info is not None]

    return asyncio.run(asyncio.wait_for(watch(), PATIENCE))


def run(jobs, work):
    """Run one job to its end; return it."""
    return watched(jobs, jobs.submit("test", {"asked": 1}, work))[-1]


def test_a_job_says_that_kernels_are_compiled(jobs):
    def work(task):
        numba.njit(lambda x: x + 1)(1)
        return {"said": task.message}

    assert run(jobs, work).result["said"].startswith("compiling the numerical kernels")


def test_a_job_ends_with_its_result(jobs, store):
    job = run(jobs, lambda task: {"answer": 42})
    assert (job.status, job.result, job.error) == ("done", {"answer": 42}, None)
    assert store.jobs.info(job.id) == job
    assert job.started is not None
    assert job.ended is not None


def test_progress_is_seen_while_it_runs(jobs):
    gate = Gate()
    job_id = jobs.submit("test", {}, gate)
    assert gate.begun.wait(PATIENCE)
    info = jobs.info(job_id)
    assert (info.status, info.progress, info.total, info.message) == ("running", 0, 2, "first half")
    gate.go_on.set()
    last = watched(jobs, job_id)[-1]
    assert (last.status, last.progress, last.total) == ("done", 1, 2)


def test_watching_tells_every_stage_and_stops_at_the_end(jobs):
    gate = Gate()
    job_id = jobs.submit("test", {}, gate)

    async def watch():
        seen = []
        async for info in jobs.watch(job_id, PATIENCE):
            assert info is not None
            seen.append(info)
            if info.message == "first half":
                gate.go_on.set()
        return seen

    seen = asyncio.run(asyncio.wait_for(watch(), PATIENCE))
    assert "first half" in [info.message for info in seen]
    assert seen[-1].status == "done"
    assert [info.status for info in seen].count("done") == 1


def test_a_quiet_job_is_said_to_be_alive(jobs):
    gate = Gate()
    job_id = jobs.submit("test", {}, gate)
    assert gate.begun.wait(PATIENCE)

    async def watch():
        quiet = 0
        async for info in jobs.watch(job_id, interval=0.001):
            quiet += info is None
            if quiet == 3:
                gate.go_on.set()
        return quiet

    assert asyncio.run(asyncio.wait_for(watch(), PATIENCE)) >= 3


def test_a_wrong_request_fails_with_its_sentence(jobs):
    def work(task):
        task.progress("collecting", 0, 1)
        raise ValueError("raise the amplitude")

    job = run(jobs, work)
    assert (job.status, job.error) == ("failed", "raise the amplitude")
    assert job.message == "failed while collecting"


def test_what_is_missing_is_named(jobs, store):
    job = run(jobs, lambda task: {"dataset": store.datasets.get("nothing")})
    assert job.status == "failed"
    assert "no dataset 'nothing'" in job.error


@pytest.mark.parametrize("error", [KeyError("secret"), RuntimeError("secret"), TypeError("secret")])
def test_a_fault_of_the_program_shows_no_detail(jobs, error):
    def work(task):
        raise error

    job = run(jobs, work)
    assert job.status == "failed"
    assert "secret" not in job.error
    assert job.id in job.error
    assert run(jobs, lambda task: {"after": True}).status == "done"


def test_a_running_job_is_cancelled_at_its_next_step(jobs):
    gate = Gate()
    job_id = jobs.submit("test", {}, gate)
    assert gate.begun.wait(PATIENCE)
    jobs.cancel(job_id)
    assert jobs.info(job_id).message == "cancelling: first half"
    gate.go_on.set()
    job = watched(jobs, job_id)[-1]
    assert (job.status, job.result) == ("cancelled", None)
    assert job.message == "cancelled while first half"


def test_a_waiting_job_is_cancelled_without_running(jobs):
    gate, ran = Gate(), []
    first = jobs.submit("test", {}, gate)
    assert gate.begun.wait(PATIENCE)
    waiting = jobs.submit("test", {}, lambda task: {"ran": ran.append(1)})
    jobs.cancel(waiting)
    gate.go_on.set()
    assert watched(jobs, waiting)[-1].status == "cancelled"
    assert watched(jobs, first)[-1].status == "done"
    assert run(jobs, lambda task: {}).status == "done"
    assert ran == []


def test_an_ended_job_cannot_be_cancelled(jobs):
    job = run(jobs, lambda task: {})
    with pytest.raises(NotRunning, match="already done"):
        jobs.cancel(job.id)
    with pytest.raises(NotFound):
        jobs.cancel("nothing")


def test_a_full_queue_refuses(jobs):
    gate = Gate()
    jobs.submit("test", {}, gate)
    assert gate.begun.wait(PATIENCE)
    waiting = [jobs.submit("test", {}, lambda task: {}) for _ in range(2)]
    with pytest.raises(QueueFull, match="2 jobs are waiting"):
        jobs.submit("test", {}, lambda task: {})
    assert (jobs.n_running, jobs.n_waiting) == (1, 2)
    gate.go_on.set()
    assert {watched(jobs, job)[-1].status for job in waiting} == {"done"}
    assert (jobs.n_running, jobs.n_waiting) == (0, 0)


def test_files_are_released_once_whether_a_job_is_queued_or_not(store):
    released = []
    jobs = Jobs(store, workers=1, queue=1)
    job = jobs.submit("test", {}, lambda task: {}, lambda: released.append("ran"))
    watched(jobs, job)
    jobs.close()
    with pytest.raises(QueueFull):
        jobs.submit("test", {}, lambda task: {}, lambda: released.append("refused"))
    assert released == ["ran", "refused"]


def test_a_request_that_is_cancelled_leaves_its_job_the_files(store, monkeypatch):
    released, queuing, go_on = [], threading.Event(), threading.Event()
    jobs = Jobs(store, workers=1, queue=1)
    submit = jobs.submit

    def slowly(*arguments):
        queuing.set()
        assert go_on.wait(PATIENCE)
        return submit(*arguments)

    monkeypatch.setattr(jobs, "submit", slowly)

    def work(task):
        return {"released": [*released]}

    async def cancelled():
        request = asyncio.create_task(
            accepted(jobs, "test", {}, work, release=lambda: released.append("files"))
        )
        assert await asyncio.to_thread(queuing.wait, PATIENCE)
        request.cancel()
        go_on.set()
        with pytest.raises(asyncio.CancelledError):
            await request

    asyncio.run(cancelled())
    (job,) = store.jobs.all()
    assert watched(jobs, job.id)[-1].result == {"released": []}
    assert released == ["files"]
    jobs.close()


def test_as_many_run_at_once_as_there_are_workers_and_no_more(store):
    gates = [Gate() for _ in range(3)]
    jobs = Jobs(store, workers=2)
    ids = [jobs.submit("test", {}, gate) for gate in gates]
    assert gates[0].begun.wait(PATIENCE)
    assert gates[1].begun.wait(PATIENCE)
    assert not gates[2].begun.is_set()
    assert jobs.info(ids[2]).status == "queued"
    for gate in gates:
        gate.go_on.set()
    assert {watched(jobs, job)[-1].status for job in ids} == {"done"}
    jobs.close()


def test_stopping_interrupts_what_runs_and_what_waits(store):
    gate = Gate()
    jobs = Jobs(store)
    running = jobs.submit("test", {}, gate)
    assert gate.begun.wait(PATIENCE)
    waiting = jobs.submit("test", {}, lambda task: {})
    closing = threading.Thread(target=jobs.close)
    closing.start()
    assert watched(jobs, waiting)[-1].status == "interrupted"
    gate.go_on.set()
    closing.join(PATIENCE)
    assert not closing.is_alive()
    assert store.jobs.info(running).status == "interrupted"
    assert "submit it again" in store.jobs.info(running).error
    with pytest.raises(QueueFull):
        jobs.submit("test", {}, lambda task: {})


def test_a_job_of_a_process_that_died_is_interrupted(tmp_path):
    dying = open_store(tmp_path / "forewarn.db")
    running, queued = dying.jobs.add("test", {}), dying.jobs.add("test", {})
    dying.jobs.update(running, status="running", progress=1, total=2)
    dying.close()
    store = open_store(tmp_path / "forewarn.db")
    jobs = Jobs(store)
    assert {jobs.info(job).status for job in (running, queued)} == {"interrupted"}
    assert watched(jobs, running)[-1].status == "interrupted"
    jobs.close()
    store.close()
