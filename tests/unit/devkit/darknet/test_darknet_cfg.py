"""devkit.darknet: the cfg text, the network it describes, and what is refused."""

from __future__ import annotations

import pytest

from devkit.darknet.build import build_network, read_network
from devkit.darknet.network import Head, MapShape, MaxPool, Route
from devkit.darknet.sections import DarknetError, parse_sections, to_text
from devkit.darknet.variant import ARCHITECTURES, architecture, architecture_network, coco_names
from devkit.darknet.weights import float_count

HEAD = (
    "[convolutional]\nfilters=14\nactivation=linear\n[yolo]\nanchors=8,8,16,20\nclasses=2\nnum=2\n"
)
NET = "[net]\nwidth=32\nheight=32\n"


def network(text: str, **size):
    return build_network(parse_sections(text, "a.cfg"), "a.cfg", **size)


def refused(text: str, **size) -> str:
    with pytest.raises(DarknetError) as caught:
        network(text, **size)
    line = str(caught.value)
    assert "\n" not in line
    return line


# --- text ---------------------------------------------------------------------------------------


def test_comments_blanks_and_carriage_returns_mean_nothing():
    text = "# all\r\n[ net ]\r\n; x\r\n width = 3 2 # behind\r\n\r\n[yolo]\nanchors = 1, 2,\n"
    net, yolo = parse_sections(text, "a.cfg")
    assert (net.name, net.line) == ("net", 2)
    assert (net.options["width"].text, net.options["width"].line) == ("32", 4)
    assert yolo.options["anchors"].text == "1,2,"


def test_text_of_sections_reads_back_the_same():
    for name in ARCHITECTURES:
        sections = architecture(name)
        again = parse_sections(to_text(sections), name)
        assert [(s.name, {k: o.text for k, o in s.options.items()}) for s in again] == [
            (s.name, {k: o.text for k, o in s.options.items()}) for s in sections
        ]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", "a.cfg: no sections; a cfg begins with [net]"),
        ("width=3\n", "a.cfg:1: 'width' before the first section, e.g. [net]"),
        ("[net]\nwidth\n", "a.cfg:2: given 'width', expected key=value"),
        ("[net]\nwidth=\n", "a.cfg:2: given 'width=', expected key=value"),
        ("[net\n", "a.cfg:1: given '[net', expected [section]"),
        ("[net]\nwidth=3\nwidth=4\n", "a.cfg:3: 'width' again, first given in line 2"),
    ],
)
def test_text_that_is_no_cfg(text, line):
    assert refused(text) == line


def test_files_that_are_no_cfg(tmp_path):
    with pytest.raises(DarknetError, match=r"none\.cfg: No such file"):
        read_network(tmp_path / "none.cfg")
    with pytest.raises(DarknetError, match="Is a directory"):
        read_network(tmp_path)
    for data in (b"\xff\xfe\x00", b"a\0b", b"[net]\n" * 300_000):
        (tmp_path / "x.cfg").write_bytes(data)
        with pytest.raises(DarknetError, match=r"x\.cfg: not a Darknet cfg"):
            read_network(tmp_path / "x.cfg")


# --- layers -------------------------------------------------------------------------------------


def test_defaults_are_darknets():
    conv, pool, *_ = network(NET + "[convolutional]\n[maxpool]\nsize=2\nstride=1\n" + HEAD).layers
    assert (conv.size, conv.stride, conv.padding, conv.groups) == (1, 1, 0, 1)
    assert (conv.activation, conv.batch_normalize, conv.shape) == ("logistic", False, (1, 32, 32))
    assert isinstance(pool, MaxPool)
    assert (pool.padding, pool.shape) == (1, (1, 32, 32))


def test_a_pool_without_size_is_as_large_as_its_stride():
    pool = network(NET + "[maxpool]\nstride=2\n" + HEAD).layers[0]
    assert (pool.size, pool.padding, pool.shape) == (2, 1, (3, 16, 16))


@pytest.mark.parametrize(("given", "padding"), [("pad=1", 2), ("padding=1", 1), ("", 0)])
def test_pad_is_half_the_kernel_and_wins_over_padding(given, padding):
    conv = network(NET + f"[convolutional]\nsize=5\n{given}\n" + HEAD).layers[0]
    assert (conv.padding, conv.shape.width) == (padding, 32 - 4 + 2 * padding)


def test_negative_indices_count_back_and_groups_pick_a_part():
    text = NET + "[convolutional]\nfilters=8\n[convolutional]\nfilters=4\n"
    layers = network(text + "[route]\nlayers=-1,-2\ngroups=2\ngroup_id=1\n" + HEAD).layers
    assert isinstance(layers[2], Route)
    assert (layers[2].inputs, layers[2].shape.channels, layers[2].group_id) == ((1, 0), 6, 1)
    layers = network(text + "[route]\nlayers=0\n" + HEAD).layers
    assert (layers[2].inputs, layers[2].shape.channels) == ((0,), 8)


def test_anchors_of_a_region_are_cells_and_of_yolo_pixels():
    region = HEAD.replace("yolo", "region").replace("8,8,16,20", "0.5,1,2,3")
    pool = "[maxpool]\nstride=8\n"
    assert network(NET + pool + region).heads()[0].anchors_px == ((4.0, 8.0), (16.0, 24.0))
    assert network(NET + pool + HEAD).heads()[0].anchors_px == ((8.0, 8.0), (16.0, 20.0))
    softmax = network(NET + pool + region + "softmax=1\n").heads()[0]
    assert softmax.scores == "softmax"


def test_a_mask_picks_anchors():
    text = HEAD.replace("filters=14", "filters=7") + "mask=1\n"
    assert network(NET + text).heads()[0].anchors_px == ((16.0, 20.0),)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("[convolutional]\n", "a.cfg:1: given [convolutional], expected [net] first"),
        (NET + "[lstm]\n", "a.cfg:4: [lstm] unknown section; allowed: "),
        (NET + "[maxpol]\n", "a.cfg:4: [maxpol] unknown section; did you mean 'maxpool'?"),
        (NET + "[convolutional]\nstrides=2\n", "a.cfg:5: [convolutional] strides: unknown key"),
        (NET + "[convolutional]\ndilation=2\n", "[convolutional] dilation: given 2, supported: 1"),
        (NET + "[convolutional]\nstride=2\nstride_x=1\n", "stride_x: given 1, supported: 2"),
        (NET + "[convolutional]\nsize=x\n", "size: given 'x', allowed: a whole number 1 to 99"),
        (NET + "[convolutional]\nsize=0\n", "size: given 0, allowed: a whole number 1 to 99"),
        (NET + "[convolutional]\nactivation=leeky\n", "given 'leeky', did you mean 'leaky'?"),
        (NET + "[convolutional]\nsize=40\n", "a.cfg:4: [convolutional] nothing is left"),
        (NET + "[convolutional]\ngroups=2\n", "groups: given 2, a divisor of 3 and 1"),
        (NET + "[route]\n", "a.cfg:4: [route] 'layers' is missing; whole numbers"),
        (NET + "[route]\nlayers=0\n", "layers: given 0, which is no layer before this one (0)"),
        (NET + "[route]\nlayers=-1\n", "given -1, which is no layer before this one (0)"),
        (NET + "[shortcut]\nfrom=-1\n", "given -1, which is no layer"),
        (NET + "[reorg]\nstride=2\n", "input 32x32x3 cannot be split with stride 2"),
        (NET + HEAD.replace("14", "15"), "classes need filters=14 in the layer before"),
        (NET + HEAD.replace("num=2", "num=3"), "given 4 numbers, 6 above 0 needed (num=3)"),
        (NET + HEAD.replace("8,8", "8,nan"), "anchors: given '8,nan,16,20', allowed: numbers"),
        (NET + HEAD + "mask=2\n", "mask: given [2], allowed: 0 to 1"),
        (NET + HEAD + "new_coords=1\n", "new_coords: given 1, supported: 0"),
        (NET + HEAD + "[convolutional]\n", "reads layer 1 [yolo], whose output is boxes"),
        (NET + "[convolutional]\n", "a.cfg: no [region] or [yolo] section, so it detects nothing"),
        ("[net]\nheight=32\n" + HEAD, "a.cfg:1: [net] 'width' is missing"),
        ("[net]\nletter_box=1\n" + NET[6:] + HEAD, "letter_box: given 1, supported: 0"),
    ],
)  # fmt: skip
def test_what_would_change_the_result_is_refused_with_its_line(text, line):
    assert line in refused(text)


def test_shapes_that_do_not_meet_are_named():
    fork = "[convolutional]\nfilters=4\n[maxpool]\nstride=2\n"
    assert "layer 1 [maxpool] is 16x16x4 but layer 0 [convolutional] is 32x32x4" in refused(
        NET + fork + "[route]\nlayers=-1,0\n"
    )
    assert "only equal shapes" in refused(NET + fork + "[shortcut]\nfrom=0\n")


# --- the published architectures ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "layers", "file_bytes", "header_bytes"),
    [
        ("yolov2", 32, 203_934_260, 16),
        ("yolov2-tiny", 16, 44_948_600, 20),
        ("yolov3", 107, 248_007_048, 20),
        ("yolov3-tiny", 24, 35_434_956, 20),
    ],
)
def test_published_weights_would_fill_the_networks_exactly(name, layers, file_bytes, header_bytes):
    found = architecture_network(name)
    assert len(found.layers) == layers
    assert sum(map(float_count, found.convolutions())) * 4 + header_bytes == file_bytes
    assert len(coco_names()) == found.heads()[0].classes == 80


@pytest.mark.parametrize("name", ARCHITECTURES)
def test_quarter_width_variants(name):
    full = architecture_network(name)
    found = architecture_network(f"{name}-w25", classes=4, width=320, height=192)
    assert found.input == MapShape(3, 192, 320)
    for wide, narrow in zip(full.layers, found.layers, strict=True):
        if isinstance(narrow, Head):
            assert narrow.shape.channels == len(wide.anchors_px) * 9
            assert narrow.anchors_px == wide.anchors_px
        elif not isinstance(full.layers[min(wide.index + 1, len(full.layers) - 1)], Head):
            assert narrow.shape.channels * 4 == wide.shape.channels
    millions = sum(map(float_count, found.convolutions())) / 1e6
    assert 0.54 < millions < 3.9


def test_anchors_of_a_variant():
    found = architecture_network("yolov3-tiny", anchors=[float(n) for n in range(1, 13)])
    assert found.heads()[0].anchors_px == ((7.0, 8.0), (9.0, 10.0), (11.0, 12.0))
    with pytest.raises(DarknetError, match="given 2 numbers, 12 needed"):
        architecture("yolov3-tiny", anchors=[1.0, 2.0])


def test_variants_out_of_range():
    with pytest.raises(DarknetError, match="architecture 'yolov5': did you mean 'yolov"):
        architecture("yolov5")
    with pytest.raises(DarknetError, match="width multiple: given 2"):
        architecture("yolov2", width_multiple=2)
    with pytest.raises(DarknetError, match="classes: given 0"):
        architecture("yolov2", classes=0)
    with pytest.raises(DarknetError, match="multiple"):
        architecture_network("yolov3", width=330)
