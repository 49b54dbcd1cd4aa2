"""Settings that every test shares."""

import os
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")  # before numpy is imported

import pytest
from hypothesis import HealthCheck, settings

sys.path.insert(0, str(Path(__file__).parent))  # small components and named problems of the tests

# the first call of a kernel includes its compilation: no deadline
settings.register_profile(
    "default", deadline=None, max_examples=50, derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],
)  # fmt: skip
settings.register_profile("nightly", deadline=None, max_examples=1000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))

ROOT = Path(__file__).parents[1]


@pytest.fixture
def scenarios() -> Path:
    """Return the folder of shipped scenarios."""
    return ROOT / "scenarios"


@pytest.fixture(scope="session")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Return ``fmus.build.build`` into a folder of this session: each FMU is made once."""
    from fmus.build import build

    return partial(build, folder=tmp_path_factory.mktemp("fmus"))
