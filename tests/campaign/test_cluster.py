"""A Dask cluster of two workers over TLS on loopback makes the same store; and is refused where it is not safe."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("distributed")

import dask
import trustme
from distributed import LocalCluster

from soter.campaign.cluster import ClusterWorkers
from soter.errors import ConfigError
from tests.campaign.here import campaign
from tests.campaign.stores import same
from tests.campaign.test_session import ran


@pytest.mark.filterwarnings("default")
def test_a_cluster_over_tls_makes_the_same_store(tmp_path: Path) -> None:
    authority = trustme.CA()
    certificate = authority.issue_cert("127.0.0.1")
    authority.cert_pem.write_to_path(tmp_path / "ca.pem")
    certificate.private_key_and_cert_chain_pem.write_to_path(tmp_path / "both.pem")
    both = str(tmp_path / "both.pem")
    tls = {
        f"distributed.comm.tls.{role}.{name}": both
        for role in ("scheduler", "worker", "client")
        for name in ("cert", "key")
    }
    tls["distributed.comm.tls.ca-file"] = str(tmp_path / "ca.pem")
    read = campaign(tmp_path, {"seeds": [1, 2, 3, 4]}, {"set": {"rta.collision.delta_s": 2.0}})
    with (
        dask.config.set({"distributed.comm.require-encryption": True, **tls}),
        LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, protocol="tls://", host="127.0.0.1"
        ) as cluster,
    ):
        assert cluster.scheduler_address.startswith("tls://")
        ran(read, tmp_path / "cluster.sqlite", ClusterWorkers(cluster.scheduler_address))
    ran(read, tmp_path / "here.sqlite")
    assert same(tmp_path / "cluster.sqlite") == same(tmp_path / "here.sqlite")


@pytest.mark.parametrize("address", ["tcp://10.0.0.1:8786", "nonsense", "tls://127.0.0.1:1"])
def test_a_scheduler_that_is_not_safe_or_not_there_is_refused(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("soter.campaign.cluster._TIMEOUT_S", 0.5)
    with pytest.raises(ConfigError, match="--cluster"):
        ClusterWorkers(address)
