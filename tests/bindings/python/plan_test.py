import numpy as np
import pytest

import volalign

RIG = {"structure_yaw_deg": 20, "sensors": [{"name": "A", "sensor": "azure_kinect_nfov_binned"}, {"name": "B", "sensor": "azure_kinect_nfov_binned", "phi_deg": 120}]}


def test_plans_a_rig():
    plan = volalign.plan(RIG, trials=1, threads=1)
    assert (plan.trials, list(plan.sensors), plan.structure.num_classes) == (1, ["A", "B"], 21)
    sensor = plan.sensors["B"]
    assert sensor.placed == 1 and 0 < sensor.expected_m < 0.05 and sensor.covariance.shape == (6, 6)
    assert np.linalg.norm(sensor.weakest) == pytest.approx(1)
    side, pixels = sensor.sides[0]
    assert "/" in side and pixels > 100
    assert "B" in str(plan)
    assert plan._repr_svg_().startswith("<svg")


def test_keywords_stand_over_the_rig(tmp_path):
    (tmp_path / "rig.yaml").write_text("sensors: [{name: A}]\n")
    with pytest.raises(volalign.ConfigError, match="nonsense"):
        volalign.plan(tmp_path / "rig.yaml", trials=1, **{"sensors[0].sensor": "nonsense"})
    with pytest.raises(volalign.ConfigError, match="trials = 0"):
        volalign.plan(RIG, trials=0)
