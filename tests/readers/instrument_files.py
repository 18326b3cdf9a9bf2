"""Files of instruments for tests: by the public library of the device where it writes, else by the published layout."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import numpy as np

CIHX = """!!! This file can not be edited. !!!
CIHX
<?xml version='1.0' encoding='UTF-8'?>
<cih>
  <fileInfo><version>1.0</version><date>2026/11/30</date><time>10:00</time></fileInfo>
  <imageFileInfo><fileFormat>Mraw</fileFormat></imageFileInfo>
  <imageDataInfo>
    <resolution><width>{nx}</width><height>{ny}</height></resolution>
    <colorInfo><type>{colour}</type><bit>{bits}</bit></colorInfo>
    <effectiveBit><depth>{depth}</depth><side>{side}</side></effectiveBit>
  </imageDataInfo>
  <frameInfo><recordedFrame>900</recordedFrame><totalFrame>{n}</totalFrame><startFrame>7</startFrame>
    <skipFrame>{step}</skipFrame></frameInfo>
  <basicInfo><comment></comment></basicInfo>
  <recordInfo><recordRate>{rate}</recordRate><shutterSpeed>200000</shutterSpeed></recordInfo>
  <deviceInfo><deviceName>FASTCAM</deviceName></deviceInfo>
</cih>
"""


def packed(values: np.ndarray, bits: int) -> bytes:
    """Values of 10 or 12 bits without gaps, the first bit first."""
    shifts = np.arange(bits - 1, -1, -1)
    return np.packbits((values.reshape(-1, 1).astype(np.uint32) >> shifts & 1).astype(np.uint8)).tobytes()


def write_mraw(path: Path, frames: np.ndarray, bits: int, *, side="Lower", step=1, rate=1000, colour="Mono",
               depth=12) -> None:
    """A film of Photron; frames : (n, ny, nx) of the values as stored."""
    n, ny, nx = frames.shape
    data = packed(frames, 12) if bits == 12 else frames.astype("<u2" if bits == 16 else "u1").tobytes()
    path.write_bytes(data)
    path.with_suffix(".cihx").write_text(CIHX.format(n=n, ny=ny, nx=nx, bits=bits, side=side, step=step, rate=rate,
                                                     colour=colour, depth=depth))


def write_cine(path: Path, frames: np.ndarray, bits: int, *, packing=0, rate=1000, stamps=None, first=-3, cfa=0,
               setup_length=11000) -> None:
    """A film of Phantom; frames : (n, ny, nx) of the values as stored; stamps : times of day in s, None: no block"""
    n, ny, nx = frames.shape
    if packing:
        images = [packed(frame, bits) for frame in frames]
    else:  # as in a bitmap, the lowest row first
        images = [frame[::-1].astype("<u2" if bits == 16 else "u1").tobytes() for frame in frames]
    setup = bytearray(setup_length)
    setup[140:144] = b"ST" + struct.pack("<H", setup_length)
    struct.pack_into("<I", setup, 768, rate)
    struct.pack_into("<I", setup, 808, cfa)
    if setup_length >= 10408:
        struct.pack_into("<f", setup, 10388, 1.0)  # every frame was saved
        struct.pack_into("<d", setup, 10400, rate)
    block = b""
    if stamps is not None:
        parts = [((int(time % 1 * 2**32)), int(time)) for time in stamps]
        block = struct.pack("<IHH", 8 + 8 * n, 1002, 0) + b"".join(struct.pack("<II", *part) for part in parts)
    places_at = 84 + len(setup) + len(block)
    place, places = places_at + 8 * n, []
    for image in images:
        places.append(place)
        place += 8 + len(image)
    header = struct.pack("<2sHHHiIiIIIIQ", b"CI", 44, 0, 1, first, n, first, n, 44, 84, places_at, 0)
    bitmap = struct.pack("<IiiHHIIiiII", 40, nx, ny, 1, 16 if packing else bits, packing, len(images[0]), 0, 0, 0, 0)
    path.write_bytes(header + bitmap + bytes(setup) + block + struct.pack(f"<{n}q", *places)
                     + b"".join(struct.pack("<II", 8, len(image)) + image for image in images))


def write_plu(path: Path, heights_um: np.ndarray, pitch_um: float) -> None:
    """A map of Sensofar; NaN where missing."""
    ny, nx = heights_um.shape
    calibration = struct.pack("<IIIfffffff", ny, nx, 0, 1.0, pitch_um, pitch_um, 0.0, 0.0, 1.0, 0.0)
    measurement = struct.pack("<5I", 3, 0, 0, 0, 0)
    settings = struct.pack("<5IdfII", nx, ny, nx, ny, 1, 0.1, 100.0, 10, 0)
    layers = struct.pack("<5B3BI", 0, 1, 0, 0, 0, 0, 0, 0, 1)
    values = np.where(np.isnan(heights_um), 1000001.0, heights_um).astype("<f4")
    path.write_bytes(b"Mon Nov 30 10:00:00 2026".ljust(128, b"\0") + struct.pack("<I", 0) + bytes(256) + calibration
                     + measurement + settings + layers + struct.pack("<II", ny, nx) + values.tobytes()
                     + struct.pack("<ff", float(np.nanmin(heights_um)), float(np.nanmax(heights_um))))


def write_plux(path: Path, heights_um: np.ndarray, pitch_um: float) -> None:
    """A map of newer Sensofar instruments: an archive with an index and a layer."""
    ny, nx = heights_um.shape
    index = ("<xml><GENERAL><DATE>Mon Nov 30 10:00:00 2026</DATE>"
             f"<FOV_X>{pitch_um}</FOV_X><FOV_Y>{pitch_um}</FOV_Y>"
             f"<IMAGE_SIZE_X>{nx}</IMAGE_SIZE_X><IMAGE_SIZE_Y>{ny}</IMAGE_SIZE_Y></GENERAL>"
             "<INFO><ITEM_0><NAME>Device</NAME><VALUE>S neox</VALUE></ITEM_0></INFO>"
             "<LAYER_0><FILENAME_Z>LAYER_0.raw</FILENAME_Z></LAYER_0></xml>")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("index.xml", index)
        archive.writestr("LAYER_0.raw", heights_um.astype("<f4").tobytes())


def write_zs2(path: Path, records: list[dict[int, np.ndarray]], names: dict[int, str]) -> None:
    """A series of testXpert by the encoder of zs2decode: a record per specimen, arrays by number of their channel."""
    from zs2decode import encoder

    chunks = []

    def section(name, *content):
        chunks.append([None, name, "DD", ""])
        for part in content:
            part()
        chunks.append([None, "", "end", []])

    def value(name, kind, content):
        return lambda: chunks.append([None, name, kind, content])

    def channels():
        for k, (number, name) in enumerate(names.items()):
            section(f"Elem{k}", value("ID", "66", number), lambda name=name: section("Name", value("Text", "AA", name)))

    def elements():
        for k, record in enumerate(records):
            section(f"Elem{k}", lambda record=record: section(
                    "SingleGroupDataBlock", value("IndexTimeChannel", "22", 0), lambda: section("DataChannels", *(
                        lambda k=k, number=number, array=array: section(
                            f"Elem{k}", value("TrsChannelId", "66", number),
                            value("DataArray", "EE04", [float(v) for v in array]))
                        for k, (number, array) in enumerate(record.items())))))

    section("Document", lambda: section("Body", lambda: section("batch",
            lambda: section("SeriesDef", lambda: section("ChannelManager", channels)),
            lambda: section("Series", lambda: section("SeriesElements", elements)))))
    encoder.save_zs2(str(path), encoder.make_datastream(encoder.make_raw_chunks(chunks)))
