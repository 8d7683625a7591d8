"""Laws without a name: only what has changed since the nominal recordings counts."""

import pytest

from softarm.analysis.diagnosis.workers import Inline
from softarm.estimator.diagnosis.diagnose import assemble, begin
from softarm.estimator.diagnosis.judge import CERTAIN
from softarm.estimator.diagnosis.unnamed import UnnamedLaw, unnamed_law
from softarm.estimator.specimen.physics import Place
from tests.estimator.diagnosis.linear_arm import LOCKING, Concealed, model, session

LAW = ((LOCKING, Place(segment="lower"), (0.05, 0.5)),)
"""Half of what the lower segment bends beyond 0.05 rad is lost."""


def law_of(nominal: Concealed, questioned: Concealed) -> UnnamedLaw:
    """Return the likeliest law of two nominal recordings and four in question, with effects of either."""
    sessions = [session(f"nominal_{k}", k, nominal, nominal=True) for k in range(2)]
    sessions += [session(f"run_{k}", 10 + k, questioned) for k in range(4)]
    search = begin(assemble(model(), sessions, Inline(), ("tip_payload",)).evidence, fast=False)
    return unnamed_law(search, None)


@pytest.mark.parametrize(("nominal", "changed"), [((), True), (LAW, False)])
def test_a_law_that_nominal_recordings_show_too_is_no_change(nominal: Concealed, *, changed: bool):
    assert (law_of(nominal, LAW).gain > CERTAIN) is changed
