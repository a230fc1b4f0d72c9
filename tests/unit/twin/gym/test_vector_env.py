"""The vectorised environment: bytes, episodes, and what it refuses."""

import copy
import pickle
import subprocess
import sys
from contextlib import closing

import numpy as np
import pytest
from gym_rigs import SMALL, driven
from gymnasium import error
from gymnasium.vector import AutoresetMode
from waiting import PATIENCE_S

from schemas.files.yaml_file import dump_yaml
from twin.base.errors import UsageError
from twin.gym import make, make_vec
from twin.gym.vector_env import ENVS_MAX

STEPS = 34
CASE = "clear"


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    path = tmp_path_factory.mktemp("gym") / "small.yaml"
    path.write_text(dump_yaml(SMALL))
    return path


@pytest.fixture(scope="module")
def three(campaign):
    with closing(make_vec(campaign, 3, reward="1")) as envs:
        yield envs


def played(envs, actions, **reset):
    """All that environments said: per step, observations with rewards and ends, and the infos."""
    seen, infos = envs.reset(**reset)
    told = [({**seen}, infos)]
    for action in actions:
        seen, reward, terminated, truncated, infos = envs.step(action)
        told.append(({**seen, "reward": reward, "end": terminated, "cut": truncated}, infos))
    return told


def same(one, other, rows, other_rows):
    for (seen, _), (others, _) in zip(one, other, strict=True):
        assert seen.keys() == others.keys()
        for name in seen:
            assert seen[name][rows].tobytes() == others[name][other_rows].tobytes(), name


def test_observations_lie_in_their_space(three):
    told = played(three, driven(1, 3, 3), seed=5)
    for seen, _ in told:
        assert three.observation_space.contains(
            {name: seen[name] for name in three.observation_space.spaces}
        )
    assert set(told[0][0]) == {
        *("vehicle", "environment", "camera", "boxes", "boxes.count", "imu", "gnss")
    }
    assert told[0][0]["camera"].shape == (3, 36, 64, 3)
    assert len({seen["camera"].tobytes() for seen, _ in told}) == 4
    assert three.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert three.metadata["render_fps"] == 10.0


def test_the_same_seed_and_actions_give_the_same_bytes_for_any_number(campaign, three):
    """Beyond an end, and into the second episode."""
    actions = driven(2, STEPS, 3)
    all_three = played(three, actions, seed=7)
    again = played(three, actions, seed=7)
    same(all_three, again, slice(None), slice(None))
    for (_, one), (_, other) in zip(all_three, again, strict=True):
        assert repr(one) == repr(other)
    with closing(make_vec(campaign, 1, reward="1")) as alone:
        for env in (0, 2):
            own = played(alone, actions[:, env : env + 1], seed=7 + env)
            same(all_three, own, env, 0)
    with pytest.raises(AssertionError):
        same(all_three, again, 0, 1)


def test_a_seed_changes_what_is_seen(three):
    action = driven(1, 1, 3)
    one, other = (played(three, action, seed=seed, options={"case": CASE}) for seed in (1, 2))
    assert one[0][0]["camera"].tobytes() != other[0][0]["camera"].tobytes()


def test_an_episode_ends_and_the_next_begins_with_the_step_after(three):
    told = played(three, driven(3, STEPS, 3), seed=5)
    ends = [np.flatnonzero(seen["end"] | seen["cut"]).tolist() for seen, _ in told[1:]]
    last = ends.index([0, 1, 2])
    assert last == 14
    seen, infos = told[last + 1]
    assert seen["cut"].all()
    assert not seen["end"].any()
    assert infos["verdict"].tolist() == ["time_up"] * 3
    assert infos["kpis"]["sim_time_s"].tolist() == [1.5] * 3
    assert infos["passed"].tolist() == [False] * 3
    before = told[last][0]
    assert seen["camera"].tobytes() == before["camera"].tobytes()  # nobody looked again
    begun, infos = told[last + 2]
    assert begun["reward"].tolist() == [0.0] * 3
    assert infos["episode"].tolist() == [1, 1, 1]
    assert infos["case"].tolist() == ["light_rain", "heavy_fog", "clear"]
    assert infos["seed"].tolist() == [5, 6, 7]
    assert told[0][1]["case"].tolist() == ["clear", "light_rain", "heavy_fog"]


def test_the_rewards_of_an_episode_are_those_of_all_its_rows(three):
    told = played(three, driven(3, 15, 3), seed=5)
    returns = sum(seen["reward"] for seen, _ in told[1:])
    assert returns.tolist() == [31.0] * 3  # ticks 0 to 30
    assert [seen["reward"][0] for seen, _ in told[1:]] == [2.0] * 14 + [3.0]


def test_an_end_in_the_middle_of_a_step(campaign):
    settings = {"scenario": {**SMALL["scenario"], "duration_s": 0.35}}
    with closing(make_vec(campaign, 1, reward="1", settings=settings)) as envs:
        told = played(envs, driven(1, 5), seed=5)
    assert [int(seen["cut"][0]) for seen, _ in told[1:]] == [0, 0, 0, 1, 0]
    assert [seen["reward"][0] for seen, _ in told[1:]] == [2.0, 2.0, 2.0, 2.0, 0.0]
    assert told[4][1]["kpis"]["ticks"].tolist() == [7.0]


def test_what_the_scenario_ends_is_terminated_and_others_go_on(campaign):
    scenario = {**SMALL["scenario"], "lateral_limit_m": 0.3, "duration_s": 5}
    with closing(make_vec(campaign, 2, settings={"scenario": scenario})) as envs:
        straight, turning = [0.0, 0.2, 0.0], [0.5, 0.2, 0.0]
        told = played(envs, [[straight, turning]] * 12, seed=5)
    ends = [seen["end"].tolist() for seen, _ in told[1:]]
    first = ends.index([False, True])
    assert not any(seen["cut"].any() for seen, _ in told[1:])
    assert told[first + 1][1]["verdict"].tolist() == [None, "lane_departure"]
    last, before = told[first + 1][0]["camera"], told[first][0]["camera"]
    assert last[1].tobytes() == before[1].tobytes()  # nobody looked again
    assert last[0].tobytes() != before[0].tobytes()
    after = told[first + 2]
    assert after[0]["reward"][0] > 0.0
    assert after[0]["reward"][1] == 0.0
    assert after[1]["_case"].tolist() == [False, True]


def test_rewards_without_seed_go_on_to_the_next_episode(three):
    three.reset(seed=5)
    _, infos = three.reset()
    assert infos["episode"].tolist() == [1, 1, 1]
    _, infos = three.reset(seed=[9, 9, 4])
    assert infos["seed"].tolist() == [9, 9, 4]
    assert infos["episode"].tolist() == [0, 0, 0]


def test_chosen_sensors_have_the_bytes_of_all(campaign, three):
    actions = driven(2, 3, 3)
    everything = played(three, actions, seed=7)
    with closing(make_vec(campaign, 3, sensors=["imu", "camera"], reward="1")) as envs:
        assert list(envs.single_observation_space.spaces) == ["camera", "imu"]
        some = played(envs, actions, seed=7)
    for (seen, _), (others, _) in zip(some, everything, strict=True):
        for name in ("camera", "imu"):
            assert seen[name].tobytes() == others[name].tobytes()


def test_a_function_of_dlpack_arrays(campaign, three):
    actions = driven(2, 2, 3)
    plain = played(three, actions, seed=7)
    with closing(make_vec(campaign, 3, reward="1", array=np.from_dlpack)) as envs:
        made = played(envs, actions, seed=7)
    same(plain, made, slice(None), slice(None))


def test_what_was_handed_out_is_not_written(three):
    seen, _ = three.reset(seed=5)
    before = {name: array.copy() for name, array in seen.items()}
    three.step(driven(1, 1, 3)[0])
    assert all((seen[name] == before[name]).all() for name in seen)


@pytest.mark.parametrize(
    ("actions", "problem"),
    [
        (np.zeros((2, 3)), r"shape \(2, 3\) given, allowed: \(3, 3\), steering_rad"),
        (np.zeros(3), r"shape \(3,\) given"),
        ([[0, np.nan, 0], [0, 0, 0], [0, 0, 0]], "throttle of environment 0 is nan, allowed: 0 to"),
        ([[0, 0, 0], [0, 0, 0], [0, 0, 1.01]], "brake of environment 2 is 1.01, allowed: 0 to 1"),
        ([[-np.inf, 0, 0]] * 3, "steering_rad of environment 0 is -inf, allowed: -1 to 1"),
        ("left", "str given, allowed: numbers of shape"),
        ([[0, 0], [0, 0, 0], [0]], "list given, allowed: numbers of shape"),
        (None, "NoneType given|shape"),
    ],
)
def test_actions_that_are_none(three, actions, problem):
    three.reset(seed=5)
    with pytest.raises(error.InvalidAction, match=problem) as told:
        three.step(actions)
    assert "\n" not in str(told.value)
    three.step(np.zeros((3, 3)))  # it goes on


def test_actions_of_environments_that_begin_anew_may_be_anything(three):
    played(three, driven(3, 15, 3), seed=5)
    three.step(np.full((3, 3), np.nan))
    with pytest.raises(error.InvalidAction):
        three.step(np.full((3, 3), np.nan))


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"num_envs": 0}, f"num_envs: 0 given, allowed: 1 to {ENVS_MAX}"),
        ({"num_envs": ENVS_MAX + 1}, f"num_envs: {ENVS_MAX + 1} given"),
        ({"num_envs": 1.5}, "num_envs: 1.5 given"),
        ({"array": "jax"}, "array: 'jax' given, allowed: numpy, dlpack or a function"),
        ({"lights": ["brake"]}, "lights: 'brake' given, allowed: a list of low, high, parking"),
        ({"render_mode": "human"}, "render_mode: 'human' given, allowed: None, rgb_array"),
        ({"device": "cuda:99"}, "cuda:99"),
        ({"sensors": ["lidar.roof"]}, "sensors: the campaign gives no 'lidar.roof'; "),
        ({"sensors": ["camera", "camera"]}, "sensors: 'camera' is named twice"),
        ({"sensors": []}, "sensors: given"),
        ({"sensors": "camera"}, "sensors: given 'camera', allowed: a list of"),
        ({"settings": {"camera": {"name": "nowhere"}}}, "nowhere"),
        (
            {"settings": {"render": False}, "render_mode": "rgb_array"},
            "render_mode: the campaign has no camera that sees",
        ),
    ],
)
def test_environments_that_cannot_be_made(campaign, options, problem):
    with pytest.raises(UsageError, match=problem) as told:
        make_vec(campaign, **options)
    assert "\n" not in str(told.value)


def test_boxes_that_the_campaign_keeps_from_its_stack(campaign):
    settings = {
        "autonomy": {
            "perception": {"net": {"type": "network", "model": "yolov3-tiny-w25"}},
        }
    }
    with pytest.raises(UsageError, match="sensors: 'boxes' is truth that the campaign keeps"):
        make_vec(campaign, sensors=["boxes"], settings=settings)


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ({"seed": -1}, "seed: -1 given, allowed: 0 to"),
        ({"seed": 2**63 - 1}, "seed: 9223372036854775808 given"),
        ({"seed": [1, 2]}, "seed: 2 given, allowed: one, or 3"),
        ({"seed": [1, None, 2]}, "seed: None given, allowed: 0 to"),
        ({"seed": 1.5}, "seed: 1.5 given, allowed: a number, or 3"),
        ({"options": {"case": 3}}, "options: case 3 given, allowed: a name, or a list of names"),
        ({"options": {"weather": "snow"}}, "options: no 'weather'; allowed: case"),
        ({"options": {"case": ["clear"]}}, "options: 1 cases given, allowed: one, or 3"),
        ({"options": {"case": "cleer"}}, "did you mean 'clear'"),
    ],
)
def test_resets_that_are_none(three, given, problem):
    with pytest.raises(UsageError, match=problem):
        three.reset(**given)


def test_a_step_that_was_interrupted_is_half_done(campaign, monkeypatch):
    with closing(make_vec(campaign, 2, reward="1")) as envs:
        whole = played(envs, driven(1, 3, 2), seed=5)
        envs.reset(seed=5)
        with monkeypatch.context() as patched:
            patched.setattr("twin.rig.engine.Engine.wait", interrupted)
            with pytest.raises(KeyboardInterrupt):
                envs.step(np.zeros((2, 3)))
        with pytest.raises(error.ResetNeeded, match="step before reset"):
            envs.step(np.zeros((2, 3)))
        again = played(envs, driven(1, 3, 2), seed=5)
    same(whole, again, slice(None), slice(None))


def interrupted(_engine):
    raise KeyboardInterrupt


def test_cases_may_be_given_as_infos_have_them(three):
    _, infos = three.reset(seed=[5, 5, 5])
    _, again = three.reset(seed=[5, 5, 5], options={"case": infos["case"]})
    assert again["case"].tolist() == infos["case"].tolist()


def test_before_a_reset_and_after_the_end(campaign):
    envs = make_vec(campaign, 1)
    with pytest.raises(error.ResetNeeded, match="step before reset"):
        envs.step(np.zeros((1, 3)))
    with pytest.raises(TypeError, match="cannot be pickled or copied; make it in the process"):
        pickle.dumps(envs)
    with pytest.raises(TypeError, match="cannot be pickled"):
        copy.deepcopy(envs)
    envs.reset()
    envs.close()
    envs.close()
    for use in (envs.reset, lambda: envs.step(np.zeros((1, 3))), envs.render):
        with pytest.raises(error.ClosedEnvironmentError, match="the environment is closed"):
            use()


FORKED = """
import os, sys, warnings
from twin.base.errors import UsageError
from twin.gym import make_vec
warnings.simplefilter("ignore", DeprecationWarning)
envs = make_vec(sys.argv[1], 1)
child = os.fork()
if not child:
    try:
        envs.reset()
    except UsageError as mistake:
        print(mistake, flush=True)
    os._exit(0)
assert os.waitpid(child, 0)[1] == 0
envs.close()
"""
"""A process of its own: a fork of one in which other tests have opened sessions may never end."""


def test_a_fork_is_told_to_make_its_own(campaign):
    words = (sys.executable, "-c", FORKED, str(campaign))
    done = subprocess.run(words, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    assert "a simulator does not outlive a fork" in done.stdout


def test_a_picture_of_every_environment(campaign):
    with closing(make_vec(campaign, 2, sensors=["vehicle"], render_mode="rgb_array")) as envs:
        seen, _ = envs.reset(seed=5)
        assert list(seen) == ["vehicle"]
        one, other = envs.render()
        assert one.shape == other.shape == (36, 64, 3)
        assert one.tobytes() != other.tobytes()
    with closing(make(campaign)) as env:
        env.reset(seed=5)
        assert env.render() is None
