# SPDX-License-Identifier: Apache-2.0
"""A picture file is read right, or refused in one line that names it."""

import os
import resource
import struct
import zlib

import numpy as np
import OpenImageIO as oiio
import PIL.Image
import pytest
from PIL import Image, PngImagePlugin, TiffImagePlugin

from internal import color, extras
from internal.errors import UserError
from internal.files import color_profile, image_io
from tests.icc_writer import rgb_profile

RNG = np.random.default_rng(0)
# Rows, columns and channels differ; its colours are as smooth as a photo's.
LEVELS = RNG.random((40, 56, 1)) * 40 + np.arange(56)[:, None] * (3, 2, 1) + (0, 20, 40)
LEVELS = LEVELS.astype(np.uint8)
PICTURE = Image.fromarray(LEVELS)
TURN = {2: 0, 3: 3, 4: 1, 5: 5, 6: 4, 7: 6, 8: 2}  # EXIF orientation: Pillow's name


def saved(path, picture=PICTURE, **options):
    picture.save(path, **options)
    return path


def exif(orientation: int) -> Image.Exif:
    tags = Image.Exif()
    tags[0x0112] = orientation
    return tags


WHOLE = {
    "baseline.jpg": {"quality": 90},
    "progressive.jpg": {"quality": 90, "progressive": True},
    "a.png": {},
    "a.webp": {},
    "a.tif": {},
    "a.bmp": {},
    "a.ppm": {},
    "a.jp2": {},
    "a.avif": {},
    "a.heic": {},
}


@pytest.mark.parametrize("name", WHOLE)
def test_a_file_cut_anywhere_is_unreadable(tmp_path, name):
    if name == "a.heic":
        pytest.importorskip("pillow_heif").register_heif_opener()
    path = saved(tmp_path / name, **WHOLE[name])
    whole = path.read_bytes()
    assert image_io.read_srgb(path).shape == LEVELS.shape
    size = len(whole)
    for kept in (0, 1, size * 8 // 100, size // 2, size * 9 // 10, size * 99 // 100):
        path.write_bytes(whole[:kept])
        with pytest.raises(UserError, match=rf"{name}: not a readable image"):
            image_io.read_srgb(path)
    for end in (b"", bytes(2), bytes(size)):  # room taken for what never came
        path.write_bytes(whole[:-2] + end)
        if name.endswith(("jpg", "png")) or not end:
            with pytest.raises(UserError, match="not a readable image"):
                image_io.read_srgb(path)


@pytest.mark.parametrize("name", ["baseline.jpg", "progressive.jpg"])
def test_what_phones_put_behind_a_jpeg_does_no_harm(tmp_path, name):
    path = saved(tmp_path / name, **WHOLE[name])
    whole = path.read_bytes()
    expected = image_io.read_srgb(path)
    for behind in (bytes(4096), whole, b"\0\0\0\x18ftypmp42" + bytes(99), whole[:200]):
        path.write_bytes(whole + behind)
        np.testing.assert_array_equal(image_io.read_srgb(path), expected)


@pytest.mark.parametrize("orientation", [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 300])
def test_upright_is_what_viewers_show_and_stored_is_without_the_tag(
    tmp_path, orientation
):
    path = saved(tmp_path / "a.png", exif=exif(orientation))
    turn = TURN.get(orientation)
    seen = PICTURE if turn is None else PICTURE.transpose(Image.Transpose(turn))
    for upright, picture in ((True, seen), (False, PICTURE)):
        read = image_io.read_srgb(path, upright=upright)
        np.testing.assert_array_equal(np.round(read * 255), np.asarray(picture))
        assert image_io.read_size(path, upright=upright) == picture.size


@pytest.mark.parametrize(
    ("mode", "name"),
    [
        *(("L", "a.jpg"), ("L", "a.png"), ("LA", "a.png"), ("RGBA", "a.png")),
        *(("P", "a.png"), ("P", "a.tif"), ("1", "a.tif"), ("RGBA", "a.webp")),
        *(("I;16", "a.png"), ("L", "a.avif"), ("RGBA", "a.avif"), ("RGB", "a.jfif")),
        *(("RGB", "a.jpe"), ("RGB", "a.tga")),
    ],
)
def test_kinds_of_pixels_are_read_and_sizes_agree(tmp_path, mode, name):
    if mode == "I;16":
        picture = Image.fromarray(LEVELS[..., 0].astype(np.uint16) * 257)
        expected = np.repeat(LEVELS[..., :1], 3, axis=-1)
    else:
        picture = PICTURE.convert(mode)
        rgba = np.asarray(picture.convert("RGBA")).astype(float)
        expected = rgba[..., :3] * rgba[..., 3:] / 255.0
    ending = {"jpe": "jpeg", "jfif": "jpeg"}.get(name[2:])
    path = saved(tmp_path / name, picture, format=ending, quality=95)
    read = image_io.read_srgb(path)
    assert read.dtype == np.float32 and read.shape == LEVELS.shape
    assert np.abs(read * 255.0 - expected).mean() < 4.0
    assert image_io.read_size(path) == picture.size


def test_alpha_uncovers_black(tmp_path):
    covered = np.dstack([LEVELS, np.full(LEVELS.shape[:2], 51, np.uint8)])
    read = image_io.read_srgb(saved(tmp_path / "a.png", Image.fromarray(covered)))
    np.testing.assert_allclose(read * 255.0, LEVELS * 0.2, atol=1e-3)


@pytest.mark.parametrize("name", ["a.png", "a.tif", "a.exr"])
def test_alpha_is_applied_once_whatever_a_format_multiplies_by_it(tmp_path, name):
    """Grey 0.8 of alpha 0.5, which the library takes as 0.4: of TIFF and EXR it stores
    that, of PNG 0.8."""
    pixels = np.full((3, 4, 4), (0.4, 0.4, 0.4, 0.5), np.float32)
    grey = 0.8 if name != "a.exr" else color.linear_to_srgb(0.8)
    kind = {"format": "float" if name == "a.exr" else "uint8"}
    read = image_io.read_srgb(oiio_file(tmp_path / name, pixels, **kind))
    np.testing.assert_allclose(read, 0.5 * grey, atol=0.005)


@pytest.mark.parametrize("name", ["a.bmp", "a.tga"])
def test_a_fourth_channel_that_is_never_set_is_no_alpha(tmp_path, name):
    unset = np.dstack([LEVELS, np.zeros(LEVELS.shape[:2], np.uint8)])
    path = saved(tmp_path / name, Image.fromarray(unset))
    np.testing.assert_allclose(image_io.read_srgb(path) * 255.0, LEVELS, atol=1e-3)
    is_alpha = image_io.read_header(path).has_alpha
    assert not is_alpha or image_io.read_alpha(path).min() == 1.0


def test_a_name_that_is_no_text_is_refused(tmp_path):
    path = saved(tmp_path / "a.png").rename(tmp_path / os.fsdecode(b"caf\xe9.png"))
    for read in (image_io.read_srgb, image_io.read_header):
        with pytest.raises(UserError, match="not UTF-8; rename it"):
            read(path)


def test_sixteen_bits_stay(tmp_path):
    values = np.linspace(0.0, 0.01, 60, dtype=np.float32).reshape(4, 5, 3)
    image_io.write(tmp_path / "a.png", values, bits=16)
    read = image_io.read_srgb(tmp_path / "a.png")
    np.testing.assert_allclose(read, values, atol=0.5 / 65535)


def test_a_name_with_the_wrong_ending_is_read_by_its_content(tmp_path):
    pytest.importorskip("pillow_heif").register_heif_opener()
    for content in ("heif", "avif", "webp", "png"):
        path = saved(tmp_path / f"{content}.jpg", format=content, quality=95)
        assert np.abs(image_io.read_srgb(path) * 255.0 - LEVELS).mean() < 6.0


def oiio_file(path, values, **attributes):
    buffer = oiio.ImageBuf(np.ascontiguousarray(values))
    buffer.set_write_format(attributes.pop("format", "float"))
    for key, value in attributes.items():
        buffer.specmod()[key] = value
    assert buffer.write(str(path))
    return path


def layered(path, **options):
    return saved(path, save_all=True, append_images=[PICTURE.rotate(180)], **options)


def preview_first(path):
    file = oiio.ImageOutput.create(str(path))
    assert file
    sizes = [(14, 10), (56, 40)]
    specs = [oiio.ImageSpec(*size, 3, "uint8") for size in sizes]
    assert file.open(str(path), specs)
    for number, spec in enumerate(specs):
        assert not number or file.open(str(path), spec, "AppendSubimage")
        file.write_image(np.zeros((spec.height, spec.width, 3), np.uint8))
    file.close()


@pytest.mark.parametrize(
    ("write", "name", "reason"),
    [
        (lambda p: saved(p, PICTURE.convert("CMYK")), "a.jpg", "colours for print"),
        (lambda p: saved(p, PICTURE.convert("CMYK")), "a.tif", "colours for print"),
        (lambda p: saved(p, Image.new("LAB", (9, 9))), "a.tif", "colours for print"),
        (layered, "a.tif", "several pictures"),
        (layered, "a.webp", "a moving picture"),
        (layered, "a.png", "a moving picture"),
        (lambda p: layered(p, default_image=True), "a.png", "a moving picture"),
        (preview_first, "a.tif", "several pictures"),
        (lambda p: saved(p, compression="lzma"), "a.tif", "save it with LZW"),
        (layered, "a.avif", "a moving picture"),
        (
            lambda p: oiio_file(p, np.full((4, 4, 3), np.nan, np.float32)),
            "a.exr",
            "not numbers",
        ),
        (
            lambda p: oiio_file(p, np.zeros((4, 4, 3), np.float32)),
            "a.tif",
            "floating point",
        ),
        (lambda p: p.mkdir(), "a.jpg", "image not found"),
        (lambda p: p.symlink_to("gone.jpg"), "a.jpg", "image not found"),
        (lambda p: p.write_text("<html>"), "a.jpg", "not a readable image"),
        (
            lambda p: saved(p, icc_profile=rgb_profile("ProPhoto")[:300]),
            "a.jpg",
            "profile is broken .* save it as sRGB",
        ),
    ],
)
def test_what_is_no_photo_is_refused_in_one_line(tmp_path, write, name, reason):
    write(tmp_path / name)
    with pytest.raises(UserError, match=rf"^\S*{name}: .*{reason}") as caught:
        image_io.read_srgb(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_the_smallest_picture_is_read(tmp_path):
    path = saved(tmp_path / "a.png", Image.new("RGB", (1, 1), (255, 0, 0)))
    np.testing.assert_array_equal(image_io.read_srgb(path), [[[1.0, 0.0, 0.0]]])


@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.tif", "a.webp", "a.heic"])
def test_profiles_are_applied_in_every_format(tmp_path, name):
    if name == "a.heic":
        pytest.importorskip("pillow_heif").register_heif_opener()
    icc = rgb_profile("ProPhoto")
    flat = Image.new("RGB", (32, 32), (120, 60, 40))
    stored = image_io.read_srgb(saved(tmp_path / name, flat, quality=95))
    read = image_io.read_srgb(saved(tmp_path / name, flat, quality=95, icc_profile=icc))
    expected = color_profile.to_srgb(stored, color_profile.from_icc(icc, 3))
    np.testing.assert_allclose(read, expected, atol=1e-6)
    assert np.abs(read - stored).max() > 0.1
    srgb = saved(tmp_path / name, flat, quality=95, icc_profile=rgb_profile("sRGB"))
    np.testing.assert_array_equal(image_io.read_srgb(srgb), stored)


def test_cameras_that_name_adobe_rgb_without_a_profile_mean_it(tmp_path):
    path = saved(tmp_path / "a.jpg", quality=95)
    stored, whole = image_io.read_srgb(path), path.read_bytes()
    entry = b"\x01\0\x02\0\x04\0\0\0R03\0"
    path.write_bytes(whole[:2] + b"\xff\xfe\0\x0e" + entry + whole[2:])
    expected = color_profile.to_srgb(stored, color_profile.adobe_rgb())
    np.testing.assert_allclose(image_io.read_srgb(path), expected, atol=1e-6)


def test_exr_holds_light_in_the_primaries_that_it_states(tmp_path):
    light = np.full((2, 2, 3), (0.2, 0.01, 2.0), np.float32)
    path = oiio_file(tmp_path / "a.exr", light)
    expected = color_profile.encode_srgb(light)
    np.testing.assert_allclose(image_io.read_srgb(path), expected, atol=1e-4)
    np.testing.assert_allclose(image_io.read_values(path), light)
    buffer = oiio.ImageBuf(light)
    p3 = (*color_profile.WIDE_PRIMARIES[12],)
    buffer.specmod().attribute("chromaticities", oiio.TypeDesc("float[8]"), p3)
    assert buffer.write(str(path))
    red, green, _ = image_io.read_srgb(path)[0, 0]
    assert red > expected[0, 0, 0] + 0.03 and green < expected[0, 0, 1] - 0.05


@pytest.mark.parametrize(("signal", "light"), [(0.5806, 1.0), (0.3808, 26 / 203)])
def test_a_photo_of_pq_in_ten_bits_is_brought_to_srgb(tmp_path, signal, light):
    pillow_heif = pytest.importorskip("pillow_heif")
    levels = np.full((16, 16, 3), round(signal * 1023) << 6, np.uint16)
    photo = pillow_heif.from_bytes("RGB;16", (16, 16), levels.tobytes())
    codes = {"color_primaries": 9, "transfer_characteristics": 16}
    photo.save(tmp_path / "a.heic", quality=-1, matrix_coefficients=0, **codes)
    read = image_io.read_srgb(tmp_path / "a.heic")
    expected = color_profile.encode_srgb(np.full((16, 16, 3), light))
    np.testing.assert_allclose(read, expected, atol=0.01)


def png_with(path, name: bytes, content: bytes, color=(148, 148, 148), **options):
    """A flat PNG with a further chunk behind its header, which is 33 bytes long."""
    whole = saved(path, Image.new("RGB", (4, 4), color), **options).read_bytes()
    checksum = struct.pack(">I", zlib.crc32(name + content))
    chunk = struct.pack(">I", len(content)) + name + content + checksum
    path.write_bytes(whole[:33] + chunk + whole[33:])
    return path


def test_codes_of_hdr_in_a_png_count_more_than_its_profile(tmp_path):
    options = {"icc_profile": rgb_profile("Display P3")}
    path = png_with(tmp_path / "a.png", b"cICP", bytes((9, 16, 0, 1)), **options)
    np.testing.assert_allclose(image_io.read_srgb(path), 1.0, atol=0.01)


@pytest.mark.parametrize(
    ("stated", "power"), [(1.0, 1.0), (1 / 1.8, 1.8), (0.45455, 0)]
)
def test_the_gamma_of_a_png_is_applied_unless_it_stands_for_srgb(
    tmp_path, stated, power
):
    content = struct.pack(">I", round(stated * 1e5))
    path = png_with(tmp_path / "a.png", b"gAMA", content)
    light = np.full((4, 4, 3), 148 / 255) ** power
    expected = color_profile.encode_srgb(light) if power else 148 / 255
    np.testing.assert_allclose(image_io.read_srgb(path), expected, atol=1e-3)


def test_a_gamma_that_nobody_means_and_one_beside_srgb_change_nothing(tmp_path):
    for gamma in (0, 1, 2**31 - 1):
        path = png_with(tmp_path / "a.png", b"gAMA", struct.pack(">I", gamma))
        np.testing.assert_allclose(image_io.read_srgb(path), 148 / 255, atol=1e-6)
    text = PngImagePlugin.PngInfo()
    text.add(b"sRGB", b"\0")
    content = struct.pack(">I", 100_000)
    path = png_with(tmp_path / "a.png", b"gAMA", content, pnginfo=text)
    np.testing.assert_allclose(image_io.read_srgb(path), 148 / 255, atol=1e-6)


@pytest.mark.parametrize("code", [9, 12])
def test_primaries_that_a_png_states_are_applied(tmp_path, code):
    wide = color_profile.WIDE_PRIMARIES[code]
    red, white = (200, 30, 30), wide[6:]
    numbers = [round(n * 1e5) for n in (*white, *wide[:6])]
    path = png_with(
        tmp_path / "a.png", b"cHRM", struct.pack(">8I", *numbers), color=red
    )
    stored = np.full((4, 4, 3), red, np.float32) / 255.0
    expected = color_profile.to_srgb(stored, color_profile.from_codes(code, 13))
    np.testing.assert_allclose(image_io.read_srgb(path), expected, atol=1e-3)
    assert np.abs(expected - stored).max() > 0.05
    broken = struct.pack(">8I", *[0] * 8)
    path = png_with(tmp_path / "a.png", b"cHRM", broken, color=red)
    np.testing.assert_allclose(image_io.read_srgb(path), stored, atol=1e-6)


XMP = (
    b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/'
    b'02/22-rdf-syntax-ns#"><rdf:Description xmlns:tiff="http://ns.adobe.com/tiff/1.0/"'
)
XMP_END = b"</rdf:RDF></x:xmpmeta>"
XMP_SPELLINGS = (
    XMP + b' tiff:Orientation="6"/>' + XMP_END,
    XMP + b"><tiff:Orientation>6</tiff:Orientation></rdf:Description>" + XMP_END,
)


def with_xmp(path, packet: bytes, **options):
    if path.suffix == ".png":
        text = PngImagePlugin.PngInfo()
        text.add_itxt("XML:com.adobe.xmp", packet.decode())
        return saved(path, pnginfo=text, **options)
    if path.suffix == ".tif":
        tags = TiffImagePlugin.ImageFileDirectory_v2()
        tags[700] = packet
        tags.tagtype[700] = 1
        return saved(path, tiffinfo=tags, **options)
    return saved(path, xmp=packet, **options)


@pytest.mark.parametrize("packet", XMP_SPELLINGS)
@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.webp", "a.tif"])
def test_an_orientation_in_xmp_alone_is_one(tmp_path, name, packet):
    """As Pillow and Windows have it; EXIF's, where there is one, counts more."""
    stored = image_io.read_srgb(saved(tmp_path / name))
    path = with_xmp(tmp_path / name, packet)
    assert image_io.read_size(path) == stored.shape[:2]
    np.testing.assert_array_equal(image_io.read_srgb(path), np.rot90(stored, -1))
    np.testing.assert_array_equal(image_io.read_srgb(path, upright=False), stored)
    if name != "a.tif":  # whose own tag is the EXIF one
        path = with_xmp(tmp_path / name, packet, exif=exif(1))
        np.testing.assert_array_equal(image_io.read_srgb(path), stored)
    path.write_bytes(path.read_bytes()[:-9] + b"tiff:Orie")  # no reason to fall
    assert image_io.read_exif(path) == image_io.Exif("")


def test_the_end_of_a_preview_is_not_the_end_of_its_photo(tmp_path):
    preview = saved(tmp_path / "b.jpg", PICTURE.resize((14, 10))).read_bytes()
    whole = saved(tmp_path / "a.jpg", quality=90).read_bytes()
    segment = b"\xff\xe1" + (len(preview) + 2).to_bytes(2, "big") + preview
    path = tmp_path / "a.jpg"
    path.write_bytes(whole[:2] + segment + whole[2:])
    assert image_io.read_srgb(path).shape == LEVELS.shape
    path.write_bytes(whole[:2] + segment + whole[2 : len(whole) * 3 // 4] + bytes(9999))
    with pytest.raises(UserError, match="not a readable image"):
        image_io.read_srgb(path)


@pytest.mark.parametrize("name", ["a.heic", "a.jpg"])
def test_the_camera_its_lens_and_its_zoom_are_known(name, tmp_path):
    if name == "a.heic":
        pytest.importorskip("pillow_heif").register_heif_opener()
    tags = Image.Exif()
    tags[0x010F], tags[0x0110] = "Maker", "Phone 9"
    more = tags.get_ifd(0x8769)
    more[0xA434], more[0xA405] = "Zoom 24-70", 26
    more[0x920A] = TiffImagePlugin.IFDRational(81, 2)
    found = image_io.read_exif(saved(tmp_path / name, exif=tags))
    assert found == image_io.Exif("Maker Phone 9", "Zoom 24-70", 40.5, 26.0)


def test_without_the_extra_a_heic_says_what_to_install(tmp_path, monkeypatch):
    pytest.importorskip("pillow_heif").register_heif_opener()
    path = saved(tmp_path / "a.heic")
    monkeypatch.setattr(extras, "has", lambda *_: False)
    for read in (image_io.read_srgb, image_io.read_size):
        with pytest.raises(UserError, match=r"a\.heic: a HEIC.*'\.\[heif\]'"):
            read(path)


def test_a_gif_is_read_whatever_index_the_library_states_of_its_alpha(tmp_path):
    PIL.Image.new("RGB", (8, 6), (51, 51, 51)).save(tmp_path / "a.gif")
    read = image_io.read_srgb(tmp_path / "a.gif")
    np.testing.assert_allclose(read, 51 / 255, atol=1e-6)


@pytest.mark.parametrize("ending", ["png", "jpg", "tif", "exr", "webp"])
def test_a_picture_that_the_disk_did_not_take_whole_is_an_error(ending, tmp_path):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20, limits[1]))  # bytes of a file
    try:
        with pytest.raises(UserError, match="cannot write"):
            image_io.write(tmp_path / f"a.{ending}", np.full((9, 9, 3), 0.5))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not list(tmp_path.iterdir())
    image_io.write(tmp_path / f"a.{ending}", np.full((9, 9, 3), 0.5))
    assert len(list(tmp_path.iterdir())) == 1
