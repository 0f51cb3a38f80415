"""What tests of ALFRED's benchmarks begin with."""

from support.eb_alfred import experiment  # noqa: F401  a fixture
