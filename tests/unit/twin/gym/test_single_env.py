"""The single environment, as Gymnasium's own checkers see it."""

import subprocess
import sys
import warnings
from contextlib import closing

import gymnasium
import numpy as np
import pytest
from gym_rigs import SMALL, driven
from gymnasium import error
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import SyncVectorEnv

from schemas.files.yaml_file import dump_yaml
from twin.gym import make, make_vec, register_shipped
from twin.gym.making import SHIPPED

SETTINGS = {key: SMALL[key] for key in ("camera", "sensors")}


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    path = tmp_path_factory.mktemp("gym") / "small.yaml"
    path.write_text(dump_yaml(SMALL))
    return path


def test_the_checker_of_gymnasium_has_nothing_to_say():
    with warnings.catch_warnings():
        # Numbers without bounds are what a speed or a distance is.
        warnings.filterwarnings("ignore", message=".*too (low|high)")
        env = gymnasium.make("drivetwin/lane-loop-v0", settings=SETTINGS, render_mode="rgb_array")
        check_env(env.unwrapped)
    env.close()
    env.close()
    assert env.unwrapped.action_space.shape == (3,)


def test_pictures_alone_have_bounds():
    with closing(
        gymnasium.make(
            "drivetwin/lane-loop-v0", sensors=["camera"], settings=SETTINGS, render_mode="rgb_array"
        )
    ) as env:
        check_env(env.unwrapped, skip_close_check=True)
        assert env.observation_space["camera"].is_bounded()


def test_gymnasium_makes_the_vectorised_one():
    with closing(
        gymnasium.make_vec("drivetwin/lane-loop-v0", num_envs=2, settings=SETTINGS)
    ) as envs:
        assert envs.num_envs == 2
        seen, _ = envs.reset(seed=3)
        assert envs.observation_space.contains(seen)
        assert envs.spec.id == "drivetwin/lane-loop-v0"


def test_gymnasium_vectorises_single_ones_to_the_same(campaign):
    """Seeds, ends and the step after an end are those of Gymnasium's own vector."""
    actions = driven(2, 18, 2)
    with (
        closing(make_vec(campaign, 2, sensors=["camera", "imu"])) as ours,
        closing(
            SyncVectorEnv([lambda: make(campaign, sensors=["camera", "imu"]) for _ in range(2)])
        ) as theirs,
    ):
        assert ours.single_observation_space == theirs.single_observation_space
        assert ours.action_space == theirs.action_space
        assert ours.metadata["autoreset_mode"] == theirs.metadata["autoreset_mode"]
        seen, others = ours.reset(seed=11)[0], theirs.reset(seed=11)[0]
        for action in [*actions, None]:
            assert all(seen[name].tobytes() == others[name].tobytes() for name in seen)
            if action is not None:
                seen, *ends, infos = ours.step(action)
                others, *other_ends, other_infos = theirs.step(action)
                assert [end.tolist() for end in ends] == [end.tolist() for end in other_ends]
                assert infos.keys() == other_infos.keys()
                for name in ("case", "verdict"):
                    assert list(infos.get(name, [])) == list(other_infos.get(name, []))


def test_an_episode_that_has_ended_is_reset_first(campaign):
    with closing(make(campaign)) as env:
        with pytest.raises(error.ResetNeeded, match="step before reset"):
            env.step([0.0, 0.0, 0.0])
        _, info = env.reset(seed=5)
        assert info == {"case": "clear", "seed": 5, "episode": 0}
        for _ in range(15):
            _, reward, terminated, truncated, info = env.step(np.zeros(3, np.float32))
            assert isinstance(reward, float)
        assert (terminated, truncated) == (False, True)
        assert info["verdict"] == "time_up"
        assert info["kpis"]["sim_time_s"] == 1.5
        with pytest.raises(error.ResetNeeded, match="the episode has ended"):
            env.step([0.0, 0.0, 0.0])
        assert env.reset()[1]["case"] == "light_rain"
        with pytest.raises(error.InvalidAction, match=r"shape \(1, 2\) given"):
            env.step([0.0, 0.0])
        with pytest.raises(error.InvalidAction, match="given, allowed"):
            env.step(0.0)


def test_what_is_shipped_is_registered_once():
    register_shipped()
    assert {f"drivetwin/{name}-v0" for name in SHIPPED} <= set(gymnasium.registry)


def test_without_gymnasium_one_line_says_what_to_install():
    code = "import sys; sys.modules['gymnasium'] = None; import twin.gym"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode != 0
    last = done.stderr.splitlines()[-1]
    assert "twin.gym needs Gymnasium: pip install 'drivetwin[gym]'" in last
