"""Workers of a Dask cluster; Dask handles TLS, and finds and restarts workers."""

from __future__ import annotations

from concurrent.futures import Executor, Future
from typing import Final
from urllib.parse import urlsplit

from distributed import Client, KilledWorker

from soter.campaign.job import Done, Job, work
from soter.errors import ConfigError

_LOOPBACK: Final = ("127.0.0.1", "::1", "localhost")
_TIMEOUT_S: Final = 10.0


class ClusterWorkers:
    """The workers of a Dask scheduler; `soter.campaign.workers.Workers`.

    They must have the same SOTER, which is checked, and see the mission files under the same paths. Certificates are
    those of Dask's own configuration, such as `DASK_DISTRIBUTED__COMM__TLS__CA_FILE`.

    Args:
        address: the scheduler's address, such as `tls://host:8786`.

    Raises:
        ConfigError: the scheduler is on a network and without TLS, or does not answer.
    """

    died: tuple[type[BaseException], ...] = (KilledWorker,)

    def __init__(self, address: str) -> None:
        parts = urlsplit(address)
        if parts.scheme != "tls" and parts.hostname not in _LOOPBACK:
            # Anyone who can connect to the scheduler can run any code there.
            raise _refusal(address, "tls://HOST:PORT; tcp:// on this host only")
        try:
            self._client: Final = Client(address, timeout=_TIMEOUT_S, set_as_default=False)
        except (OSError, TypeError, ValueError) as failure:
            raise _refusal(address, f"a Dask scheduler that answers ({failure})") from failure
        self._executor: Final[Executor] = self._client.get_executor(pure=False)
        # Two runs for each thread, so that none waits for this process.
        self.count = 2 * max(1, sum(self._client.nthreads().values()))

    def __enter__(self) -> ClusterWorkers:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown(wait=False)
        self._client.close()

    def submit(self, job: Job) -> Future[Done]:
        return self._executor.submit(work, job)


def _refusal(address: str, allowed: str) -> ConfigError:
    return ConfigError(f"it is '{address}', allowed: {allowed}", source="command line", key="--cluster")
