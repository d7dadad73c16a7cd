"""`bilevel up`, `status`, `down`: a Ray head and an MLflow server beside the studies.

What was started stands in `services.json` of the home; studies of that home join it,
and `down` ends that and nothing else.
"""

import json
import os
import secrets
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

import psutil
from filelock import FileLock, Timeout

from bilevel.decode import decode_file
from bilevel.durable import write_aside
from bilevel.errors import InvalidInput
from cluster.services.family import end_family
from cluster.services.mlflow_server import mlflow_server, pages
from cluster.services.ports import free_port, reachable, require_free
from cluster.services.programs import program
from cluster.storage.home import Home
from cluster.storage.run_folder import is_held
from cluster.tracking.database import database_ready, experiments
from cluster.tracking.experiment import HOME_PAGE

#: What whoever joins a service takes over of its environment.
_JOINING = {"RAY_AUTH_MODE", "RAY_AUTH_TOKEN_PATH"}

#: Seconds until a service that starts must answer, and until one that answers counts as slow.
_START, _ANSWER = 120.0, 3.0
#: Seconds that who wants to join waits for a service that does not answer.
PATIENCE = 30.0


@dataclass(frozen=True)
class Service:
    """A process in the background, with all its children."""

    name: str  # ray, mlflow
    pid: int
    #: Seconds from the machine's start to the process's, which no change of the clock moves; tells
    #: the process from a later one of that number.
    created: float
    address: str  # where studies reach it
    page: str  # where people do
    health: str  # answers if it is well
    log: str
    environment: dict[str, str]  # of the service, and of whoever wants to reach it
    boot: str = ""  # which start of the machine; empty where it cannot be told

    @property
    def process(self) -> psutil.Process | None:
        """The process, if it is still the one that was started."""
        try:
            process = psutil.Process(self.pid)
            same = self.boot == boot_id() and abs(since_boot(process) - self.created) < 1.0
            return process if same and process.status() != psutil.STATUS_ZOMBIE else None
        except psutil.NoSuchProcess:
            return None

    @property
    def state(self) -> str:
        """up, not answering, or gone."""
        if self.process is None:
            return "gone"
        return "up" if _answers(self.health) else "not answering"


def services(home: Home) -> list[Service]:
    """The services that `up` started in this home. Raises InvalidInput if the record is damaged."""
    path = _record(home)
    if not path.exists():
        return []
    try:
        return decode_file(list[Service], path)
    except InvalidInput as error:
        raise InvalidInput(
            f"{error}; delete it, and end what `up` had started in this home: `ray stop`, and the "
            "process of `mlflow server`"
        ) from None


def join(name: str, home: Home) -> str | None:
    """Address of a running service of this home, None if it is gone. Sets the token with which
    this process and its children may use it. To be called before Ray is imported.

    Raises InvalidInput for one that runs, but does not answer for PATIENCE seconds.
    """
    for service in services(home):
        if service.name != name:
            continue
        deadline = time.monotonic() + PATIENCE
        while (state := service.state) == "not answering":
            if time.monotonic() > deadline:
                raise InvalidInput(
                    f"{name}, which `up` started, runs (process {service.pid}) but does not "
                    f"answer: see {home.hint('status')}, or end it with {home.hint('down')}"
                )
            time.sleep(0.5)
        if state == "up":
            os.environ.update(
                {name: service.environment[name] for name in _JOINING & service.environment.keys()}
            )
            return service.address
    return None


def up(
    home: Home,
    host: str,
    ray_port: int,
    dashboard_port: int,
    mlflow_port: int,
    log: Callable[[str], None],
) -> None:
    """Start what is not up yet, and wait until it is well.

    Raises InvalidInput if the database is damaged, a port is taken, a service does not come up, or
    another `up` or `down` is under way; then what this call started has ended again.
    """
    home.prepare()
    ports = {"ray": (ray_port, dashboard_port), "mlflow": (mlflow_port,)}
    starts: dict[str, Callable[[], Service]] = {
        "ray": lambda: _start_ray(home, host, ray_port, dashboard_port),
        "mlflow": lambda: _start_mlflow(home, host, mlflow_port),
    }
    with _alone(home):
        known = [service for service in services(home) if service.process is not None]
        for service in known:
            log(f"{service.name} is up already: {service.page}")
            starts.pop(service.name, None)
        if "mlflow" in starts and home.database.exists():
            experiments(home.database)  # raises for one that is damaged
        for name in starts:
            for port in ports[name]:
                require_free(host, port)
        _start_all(home, starts, known, log)


def _start_all(
    home: Home,
    starts: Mapping[str, Callable[[], Service]],
    known: Sequence[Service],
    log: Callable[[str], None],
) -> None:
    """Start services beside those that are `known`; all of them, or none stays."""
    started: list[Service] = []
    try:
        for name, start in starts.items():
            log(f"starting {name}")
            started.append(start())
            _save(home, [*known, *started])
            _wait_until_well(started[-1])
            log(f"{name} is up: {started[-1].page}")
            if name == "mlflow":
                for page in pages(home, started[-1].address):
                    log(f"     {page}")
            if name == "ray":
                log(
                    "     dashboard and jobs answer on that address alone; Ray's own ports are "
                    "open on all addresses of this machine, to whoever has this home's token"
                )
    except BaseException:
        for service in reversed(started):
            _end(service)
        _save(home, known)
        raise


def down(home: Home, log: Callable[[str], None]) -> None:
    """End what `up` started, children included. Raises InvalidInput while another `up` or `down` is
    under way, and for processes of another user."""
    if not services(home):
        log(f"nothing is up in {str(home.folder)!r}")
        return
    with _alone(home):
        with suppress(OSError):  # a folder that cannot be read
            for folder in filter(is_held, home.runs()):
                name = f"{folder.parent.name}/{folder.name}"
                log(f"{name} is being run: if by this Ray head, it ends; its command resumes it")
        for service in reversed(services(home)):
            gone = service.process is None
            _end(service)
            log(f"{service.name} {'was gone' if gone else 'is down'}")
        _record(home).unlink(missing_ok=True)


@contextmanager
def _alone(home: Home) -> Iterator[None]:
    """Within the block no other process starts or ends this home's services. Raises
    InvalidInput."""
    lock = FileLock(home.folder / ".services.lock")
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise InvalidInput(
            f"another `up` or `down` is under way in {str(home.folder)!r}: wait until it has ended"
        ) from None
    try:
        yield
    finally:
        lock.release()


def _start_ray(home: Home, host: str, port: int, dashboard_port: int) -> Service:
    local = reachable(host)
    command = ["ray", "start", "--head", "--block", "--disable-usage-stats", "--port", str(port)]
    command += ["--node-ip-address", local, "--include-dashboard", "true"]
    command += ["--dashboard-host", host, "--dashboard-port", str(dashboard_port)]
    # Fixed by default, and then in the way of any other Ray on this machine.
    command += ["--ray-client-server-port", str(free_port())]
    command += ["--dashboard-agent-listen-port", str(free_port())]
    page = f"http://{local}:{dashboard_port}"
    return _start(
        home, "ray", command, f"{local}:{port}", page, f"{page}/api/gcs_healthz", _ray_token(home)
    )


def _ray_token(home: Home) -> dict[str, str]:
    """A token for this home's Ray alone, which only its owner can read: whoever reaches
    a Ray cluster can run code on it."""
    path = home.folder / "ray.token"
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(descriptor, "w") as file:
        file.write(secrets.token_hex(32))
    return {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN_PATH": str(path)}


def _start_mlflow(home: Home, host: str, port: int) -> Service:
    with database_ready(home.database_uri):
        pass  # a server that is ended while it makes one would leave it unusable
    command, environment = mlflow_server(home, host, port)
    page = f"http://{reachable(host)}:{port}"
    return _start(home, "mlflow", command, page, page + HOME_PAGE, f"{page}/health", environment)


def _start(
    home: Home,
    name: str,
    command: Sequence[str],
    address: str,
    page: str,
    health: str,
    environment: dict[str, str],
) -> Service:
    log = home.folder / f"{name}.log"
    with log.open("w") as output:
        process = subprocess.Popen(
            [program(command[0]), *command[1:]],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env={**os.environ, **environment},
            start_new_session=True,  # a terminal's Ctrl-C is not for it
        )
    created = since_boot(psutil.Process(process.pid))
    facts = address, page, health, str(log), environment
    return Service(name, process.pid, created, *facts, boot_id())


def boot_id() -> str:
    """Tells this start of the machine from others, on Linux; else empty."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return ""


def since_boot(process: psutil.Process) -> float:
    """Seconds from the machine's start to the process's."""
    return float(process.create_time() - psutil.boot_time())


def _wait_until_well(service: Service) -> None:
    begun = time.monotonic()
    while service.state != "up":
        if service.process is None:
            raise InvalidInput(f"{service.name} ended at once: see {service.log}")
        if time.monotonic() - begun > _START:
            raise InvalidInput(f"{service.name} does not answer: see {service.log}")
        time.sleep(0.2)


def _end(service: Service) -> None:
    process = service.process
    if process is not None:
        end_family(process)


def _answers(url: str) -> bool:
    direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with direct.open(url, timeout=_ANSWER) as answer:
            return bool(answer.status == 200)
    except (OSError, urllib.error.URLError, ValueError):
        return False


def _record(home: Home) -> Path:
    return home.folder / "services.json"


def _save(home: Home, found: Sequence[Service]) -> None:
    text = json.dumps([asdict(service) for service in found], indent=2)
    write_aside(_record(home), text.encode())
