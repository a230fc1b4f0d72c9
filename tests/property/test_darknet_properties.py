"""Any Darknet network of a few layers is imported right; any damaged file is refused in a line."""

from __future__ import annotations

import numpy as np
import onnxruntime
from darknet_oracle import forward, random_weights
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from devkit.darknet.build import build_network
from devkit.darknet.network import Head
from devkit.darknet.onnx_writer import write_onnx
from devkit.darknet.sections import DarknetError, parse_sections, to_text
from devkit.darknet.variant import ARCHITECTURES, architecture
from devkit.darknet.weights import read_weights, write_weights

HEAD = "[convolutional]\nfilters=7\nactivation=linear\n[yolo]\nanchors=8,8\nclasses=2\nnum=1\n"


def attempt(action, begin: str):
    """What ``action`` returns, or None after a refusal of one line that begins with ``begin``."""
    try:
        return action()
    except DarknetError as refusal:
        line = str(refusal)
    assert line.startswith(begin)
    assert "\n" not in line
    return None


@st.composite
def sections(draw) -> str:
    """Up to six layers that may or may not fit together."""
    text = ""
    for index in range(draw(st.integers(1, 6))):
        kind = draw(
            st.sampled_from(
                ["convolutional"] * 3 + ["maxpool", "route", "shortcut", "upsample", "reorg"]
            )
        )
        small = draw(st.integers(1, 4))
        text += f"[{kind}]\n"
        if kind == "convolutional":
            text += f"filters={4 * small}\nsize={draw(st.integers(1, 5))}\n"
            text += f"stride={draw(st.integers(1, 2))}\npad={draw(st.integers(0, 1))}\n"
            text += f"groups={draw(st.sampled_from([1, 1, 2, 4]))}\n"
            text += f"batch_normalize={draw(st.integers(0, 1))}\n"
            text += f"activation={draw(st.sampled_from(['leaky', 'linear', 'mish', 'logistic']))}\n"
        elif kind == "maxpool":
            text += f"size={draw(st.integers(1, 5))}\nstride={small}\n"
        elif kind == "route":
            layers = draw(st.lists(st.integers(-4, index), min_size=1, max_size=3))
            groups = draw(st.sampled_from([1, 1, 2, 4]))
            text += f"layers={','.join(map(str, layers))}\ngroups={groups}\n"
            text += f"group_id={draw(st.integers(0, groups - 1))}\n"
        elif kind == "shortcut":
            text += f"from={draw(st.integers(-3, -1))}\nactivation=leaky\n"
        else:
            text += f"stride={draw(st.integers(1, 2))}\n"
    return text


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.filter_too_much])
@given(sections(), st.integers(8, 20), st.integers(8, 20), st.booleans())
def test_any_network_that_is_accepted_computes_what_darknet_does(text, width, height, fold):
    cfg = f"[net]\nwidth={width}\nheight={height}\n{text}{HEAD}"
    network = attempt(lambda: build_network(parse_sections(cfg, "a.cfg"), "a.cfg"), "a.cfg")
    assume(network is not None)
    weights = random_weights(network, width)
    images = np.random.default_rng(height).random((2, *network.input), dtype=np.float32)
    expected = forward(network, weights, images)[-1]
    model = write_onnx(network, weights, ["a", "b"], fold=fold)
    session = onnxruntime.InferenceSession(
        model.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    (found,) = session.run(None, {"images": images})
    assert found.shape == expected.shape
    assert np.allclose(found, expected, atol=1e-4 * max(1.0, float(np.abs(expected).max())))


@settings(max_examples=100, deadline=None)
@given(st.sampled_from(ARCHITECTURES), st.data())
def test_a_damaged_cfg_is_a_network_or_one_line(name, data):
    lines = to_text(architecture(name)).split("\n")
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(lines) - 1))
        line = data.draw(
            st.one_of(
                st.just(lines[at][:-1]),
                st.just(
                    lines[at] + data.draw(st.sampled_from(["9", "-1", "e9", ",", "=", "]", "x"]))
                ),
                st.sampled_from(lines),
                st.text(max_size=12),
            )
        )
        lines[at] = line
    text = "\n".join(lines)
    network = attempt(lambda: build_network(parse_sections(text, "a.cfg"), "a.cfg"), "a.cfg")
    assert network is None or any(isinstance(layer, Head) for layer in network.layers)


@settings(max_examples=60, deadline=None)
@given(size=st.integers(0, 3000), change=st.sampled_from(["cut", "more", "noise"]))
def test_weights_of_another_size_are_refused(tmp_path_factory, size, change):
    network = build_network(parse_sections(f"[net]\nwidth=8\nheight=8\n{HEAD}", "a.cfg"), "a.cfg")
    path = tmp_path_factory.mktemp("weights") / "a.weights"
    write_weights(path, network, random_weights(network, 1))
    data = path.read_bytes()
    noise = np.random.default_rng(size).integers(0, 256, size, dtype=np.uint8).tobytes()
    damaged = {"cut": data[: size % len(data)], "more": data + noise + b"x", "noise": noise}
    path.write_bytes(damaged[change])
    assert attempt(lambda: read_weights(path, network), str(path)) is None
