"""The same worlds on the workers of a Dask scheduler: equal bytes, and none lost with a worker."""

import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.truth.worlds import draw_world

pytestmark = pytest.mark.long  # studies and campaigns run in processes of their own

distributed = pytest.importorskip("distributed")
dask = pytest.importorskip("dask")


@pytest.fixture
def scheduler(experiment):
    """A scheduler with two workers, processes of their own; after the experiments are there."""

    def start(**options):
        cluster = distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, **options
        )
        clusters.append(cluster)
        return cluster.scheduler_address

    clusters = []
    yield start
    for cluster in clusters:
        cluster.close()


def test_numbers_are_the_same_and_a_killed_worker_loses_nothing(
    tmp_path, experiment, campaign, counted, scheduler
):
    seed = draw_world(0, 1).seed
    experiment(
        "toy",
        f"""
    if context.seed == {seed} and not (FOLDER / "killed").exists():
        (FOLDER / "killed").touch()
        os.kill(os.getpid(), signal.SIGKILL)
""",
    )
    address = scheduler()
    result = campaign("toy", worlds=4, cluster=address)
    assert (result.worlds, result.failures) == (4, {})
    assert (tmp_path / "killed").exists()
    campaign("toy", worlds=4, folder="here", jobs=2)
    assert counted("ran_toy") == 8
    tables = [(tmp_path / name / "campaign.parquet").read_bytes() for name in ("campaign", "here")]
    assert tables[0] == tables[1]


@pytest.mark.slow
def test_real_experiments_give_the_same_bytes_on_a_cluster(tmp_path, campaign, scheduler):
    """What shares results in a folder, trains networks and runs compiled loops, shortened."""
    names = ("identification", "friction", "combined", "repeat-cycle")
    tables = []
    for folder, address in (("there", scheduler()), ("here", None)):
        result = campaign(*names, worlds=2, quick=True, folder=folder, cluster=address)
        assert (result.worlds, result.failures) == (2, {})
        tables.append((tmp_path / folder / "campaign.parquet").read_bytes())
    assert tables[0] == tables[1]


def test_a_world_that_takes_every_worker_down_is_listed(experiment, campaign, scheduler):
    seed = draw_world(0, 1).seed
    experiment("toy", f"    if context.seed == {seed}: os.kill(os.getpid(), signal.SIGKILL)")
    with dask.config.set({"distributed.scheduler.allowed-failures": 0}):
        result = campaign("toy", worlds=3, cluster=scheduler())
    assert result.worlds == 2
    assert list(result.failures) == [1]
    assert "killed" in result.failures[1].failures["toy"]


def test_a_scheduler_without_workers_is_refused(experiment, campaign):
    experiment("toy")
    with (
        distributed.LocalCluster(n_workers=0, dashboard_address=None) as cluster,
        pytest.raises(InputError, match="has no workers"),
    ):
        campaign("toy", cluster=cluster.scheduler_address)


def test_workers_of_other_software_are_refused(experiment, campaign, monkeypatch):
    from wrenchsight.analyses.campaign import campaign as module

    experiment("toy")
    monkeypatch.setattr(module, "software_hash", lambda name: "another")
    with pytest.raises(InputError, match="has another version of fake_toy"):
        campaign("toy", worlds=1, jobs=1)
