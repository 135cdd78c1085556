"""What befalls a site, by name: each fault is done and mended in one call, and says what happened."""

from __future__ import annotations

import json
import socket
import time
from collections import Counter
from collections.abc import Callable

import numpy as np
import zenoh
from attacks.programs import SettableClock, held
from fuzzing.payloads import KINDS, good_payloads, mangled

from gpcorrect_service import ServiceError
from gpcorrect_service.protocol.messages import ErrorAnswer, error_codec
from gpcorrect_service.protocol.sessions import open_client
from soaks.site import Site

Fault = Callable[[Site, np.random.Generator], str]
DAY = 86_400  # s
GARBAGE_SECONDS, GARBAGE_RATE = 6.0, 50.0  # 1/s
PATIENCE = 8.0  # s that the operator waits for the replicas


def kill(site: Site, rng: np.random.Generator) -> str:
    """Kill a replica, and start it again after a while."""
    replica = site.replicas[rng.integers(len(site.replicas))]
    replica.kill()
    time.sleep(away := rng.uniform(0.5, 4.0))
    replica.start()
    return f"away for {away:.1f} s"


def stop(site: Site, rng: np.random.Generator) -> str:
    """Let a replica stand still."""
    return _stood(site.replicas[rng.integers(len(site.replicas))].pid, rng)


def stop_planner(site: Site, rng: np.random.Generator) -> str:
    """Let a planner stand still: what waits for it is old when it goes on."""
    return _stood(site.planners[rng.integers(len(site.planners))].pid, rng)


def stop_router(site: Site, rng: np.random.Generator) -> str:
    """Let the router stand still: all that it held comes at once when it goes on."""
    return _stood(site.router.pid, rng)


def _stood(pid: int, rng: np.random.Generator) -> str:
    with held(pid):
        time.sleep(seconds := rng.uniform(1.0, 6.0))
    return f"stood for {seconds:.1f} s"


def restart(site: Site, rng: np.random.Generator) -> str:
    """Ask a replica to end, and start it at once."""
    replica = site.replicas[rng.integers(len(site.replicas))]
    status = replica.stop()
    replica.start()
    return f"ended with {status}"


def full_disk(site: Site, rng: np.random.Generator) -> str:
    """Leave no room for store and logs; ask for another model meanwhile, and restart a replica."""
    with site.full_disk():
        happened = f"{activate(site, rng)}; restart {restart(site, rng)}"
        time.sleep(rng.uniform(2.0, 5.0))
    return happened


def clock(site: Site, rng: np.random.Generator) -> str:
    """Set the date of one process by up to a day, and back."""
    chosen = [site.router, *site.replicas, *site.planners]
    program = chosen[rng.integers(len(chosen))]
    seconds = int(rng.integers(-DAY, DAY))
    program.clock.set(seconds)
    time.sleep(rng.uniform(3.0, 8.0))
    program.clock.set(0)
    return f"{seconds} s"


def router(site: Site, rng: np.random.Generator) -> str:
    """Kill the router, and start it again after a while."""
    site.router.kill()
    time.sleep(away := rng.uniform(0.5, 3.0))
    site.router.start()
    return f"away for {away:.1f} s"


def garbage(site: Site, rng: np.random.Generator) -> str:
    """Send random, cut and flipped payloads to every key, and what is no zenoh to the router's port."""
    whole, replies = good_payloads(site.store.path(site.entries[0])), Counter[str]()
    host, port = json.loads(site.client_config.read_text())["connect"]["endpoints"][0].removeprefix("tcp/").split(":")
    with open_client(site.settings) as session:
        queriers = [session.declare_querier(f"{site.settings.arm}/{kind}", timeout=2.0) for kind in KINDS]
        until = time.monotonic() + GARBAGE_SECONDS
        while (now := time.monotonic()) < until:
            payload, encoding = mangled(rng, whole)
            for reply in queriers[rng.integers(len(queriers))].get(payload=payload, encoding=encoding):
                replies[_status(reply)] += 1
            if rng.random() < 0.1:
                with socket.create_connection((host, int(port)), 2.0) as stranger:
                    stranger.sendall(rng.bytes(int(rng.integers(1, 400))))
            time.sleep(max(0.0, now + 1.0 / GARBAGE_RATE - time.monotonic()))
    return ", ".join(f"{number} {status}" for status, number in replies.most_common())


def _status(reply: zenoh.Reply) -> str:
    if reply.ok is not None:
        return "answered"
    codec = error_codec(str(reply.err.encoding))
    return "zenoh's own" if codec is None else codec.decode(ErrorAnswer, reply.err.payload.to_bytes()).status


def activate(site: Site, rng: np.random.Generator) -> str:
    """Activate another model on every replica."""
    try:
        return f"{site.activate_other(PATIENCE)} replicas took it"
    except ServiceError as error:
        return f"{error.status}: {error.message}"


FAULTS: dict[str, Fault] = {
    "replica killed": kill,
    "replica stopped": stop,
    "replica restarted": restart,
    "planner stopped": stop_planner,
    "router stopped": stop_router,
    "router lost": router,
    "disk full": full_disk,
    "clock step": clock,
    "garbage": garbage,
    "activation": activate,
}


def impossible() -> dict[str, str]:
    """Return which faults this machine does not allow, and why."""
    reason = SettableClock.missing()
    return {"clock step": reason} if reason else {}
