"""One more case of what others show already: `make test-long` runs it, `.ci/run` does not."""

from functools import partial

import pytest

long_case = partial(pytest.param, marks=pytest.mark.long)
