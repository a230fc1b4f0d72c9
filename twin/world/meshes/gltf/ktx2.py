"""KTX 2 pictures with a Basis Universal payload (ETC1S or UASTC), KHR_texture_basisu."""

from __future__ import annotations

from PIL import Image

SIGNATURE = b"\xabKTX 20\xbb\r\n\x1a\n"


def is_ktx2(data: bytes) -> bool:
    """Whether bytes begin as a KTX 2 file does."""
    return data.startswith(SIGNATURE)


def read_ktx2(data: bytes, pixels_max: int) -> Image.Image:
    """The largest level of a picture, RGBA.

    Args:
        data: the file.
        pixels_max: largest picture that is decoded [px].

    Raises:
        ValueError: no such picture, too large, or the library is not installed; one line.
    """
    try:
        import opengl_basisu
    except ModuleNotFoundError:
        raise ValueError("KTX 2: install drivetwin[gltf], or export PNG or JPEG") from None
    texture = opengl_basisu.open(data)
    if texture.width * texture.height > pixels_max:
        raise ValueError(f"{texture.width} x {texture.height} px")
    return Image.fromarray(texture.transcode("rgba8").data, "RGBA")
