"""Jobs whose tasks go to a Dask cluster by TLS, with certificates made here."""

import shutil
import subprocess
import sys

import pytest

import drystone
from conftest import TOWN

distributed = pytest.importorskip("distributed")

OPTIONS = {"ratio": 0.5, "cluster_faces": 2000, "passes": 1, "threads": 1, "memory": "128MiB"}


@pytest.fixture(scope="module")
def certificates(tmp_path_factory):
    """Files of a certificate authority, of a certificate that it signed, and of its key."""
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("no openssl to make certificates with")
    folder = tmp_path_factory.mktemp("certificates")
    key = "-newkey rsa:2048 -nodes"
    for line in [
        f"req -x509 {key} -keyout ca.key -out ca.pem -subj /CN=authority -days 2",
        f"req {key} -keyout own.key -out own.csr -subj /CN=machine",
        "x509 -req -in own.csr -CA ca.pem -CAkey ca.key -CAcreateserial -out own.pem -days 2",
    ]:
        subprocess.run([openssl, *line.split()], cwd=folder, check=True, capture_output=True)
    return {"ca": folder / "ca.pem", "cert": folder / "own.pem", "key": folder / "own.key"}


@pytest.fixture
def cluster(certificates):
    files = {"tls_ca_file": str(certificates["ca"]), "require_encryption": True}
    for who in ("scheduler", "worker", "client"):
        files |= {f"tls_{who}_cert": str(certificates["cert"]), f"tls_{who}_key": str(certificates["key"])}
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=True,
        protocol="tls",
        security=distributed.Security(**files),
        dashboard_address=None,
        worker_dashboard_address=None,
    ) as cluster:
        yield cluster


def test_tasks_go_by_tls_to_who_has_a_certificate(cluster, certificates, tmp_path):
    assert cluster.scheduler_address.startswith("tls://")
    alone, helped, refused = (tmp_path / name / "town.obj" for name in ("alone", "helped", "refused"))
    drystone.simplify(TOWN, alone, **OPTIONS)
    runner = f"{sys.executable} -m drystone.dask {cluster.scheduler_address} {{stage}} {{count}}"
    runner += " --threads 1 --memory 128MiB"
    files = " ".join(f"--tls-{name} '{path}'" for name, path in certificates.items())
    drystone.simplify(TOWN, helped, **OPTIONS, task_runner=f"{runner} {files}", tasks=6)
    assert helped.read_bytes() == alone.read_bytes()
    runner = f"DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT=3s {runner}"
    with pytest.raises(drystone.TaskError, match="has no result after 1"):
        drystone.simplify(TOWN, refused, **OPTIONS, task_runner=runner, tasks=6, task_tries=1)
