"""Every format of scans, read as other libraries wrote it; rows without a value are dropped and counted."""

from __future__ import annotations

import struct
import sys
import zipfile
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from calib.errors import ScanError
from calib.scans.scan import Scan, load_scan, write_scan
from tests.support.scan_mutations import las


def plyfile() -> Any:
    """Module `plyfile`, an independent reader and writer; a test that asks for it is skipped where it is missing."""
    return pytest.importorskip("plyfile")


RNG = np.random.default_rng(3)
POINTS = RNG.uniform(-300, 900, (500, 3)).astype(np.float32).astype(np.float64)
NORMALS = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)


def load(folder: Path, name: str, content: str | bytes) -> Scan:
    (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return load_scan(folder / name)


# ---- .ply and .pcd, written by Open3D ------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
@pytest.mark.parametrize("how", [{"write_ascii": True}, {}, {"compressed": True}])
@pytest.mark.parametrize("extras", ["", "normals", "normals colours"])
def test_open3d_writes_it_and_it_reads_the_same(tmp_path: Path, suffix: str, how: dict[str, bool], extras: str) -> None:
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(POINTS))
    if "normals" in extras:
        cloud.normals = open3d.utility.Vector3dVector(NORMALS)
    if "colours" in extras:
        cloud.colors = open3d.utility.Vector3dVector(np.abs(NORMALS))
    path = tmp_path / f"a{suffix}"
    open3d.io.write_point_cloud(str(path), cloud, **how)
    scan = load_scan(path)
    np.testing.assert_allclose(scan.points_mm, POINTS, atol=1e-3)  # Open3D writes .pcd text with ten digits
    assert (scan.normals is not None) == ("normals" in extras)
    if scan.normals is not None:
        np.testing.assert_allclose(scan.normals, NORMALS, atol=1e-6)
    if suffix == ".pcd":
        whole = path.read_bytes()
        with pytest.raises(ScanError, match="promises 500 points, it holds"):
            load(tmp_path, "cut.pcd", whole[: len(whole) * 2 // 3])


def ply(line_end: str, order: str, elements: str, body: bytes) -> bytes:
    head = f"ply\nformat {order} 1.0\ncomment end_header is not here\n{elements}\nend_header\n"
    return head.replace("\n", line_end).encode() + body


VERTEX = "element vertex 500\nproperty uchar red\nproperty double x\nproperty float y\nproperty short z"


@pytest.mark.parametrize("line_end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("order", ["<", ">"])
def test_any_vertex_layout_behind_any_other_element(tmp_path: Path, line_end: str, order: str) -> None:
    row = np.dtype([("red", "u1"), ("x", order + "f8"), ("y", order + "f4"), ("z", order + "i2")])
    table = np.zeros(500, row)
    for name, column in zip("xyz", np.round(POINTS).T, strict=True):
        table[name] = column
    before = "element camera 2\nproperty float focal\nelement view 3\nproperty uchar a\nproperty int b\n"
    kind = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    content = ply(line_end, kind, before + VERTEX, bytes(8 + 15) + table.tobytes())
    np.testing.assert_array_equal(load(tmp_path, "a.ply", content).points_mm, np.round(POINTS))
    with pytest.raises(ScanError, match="promises 500 points, it holds 499"):
        load(tmp_path, "a.ply", content[:-1])
    with pytest.raises(ScanError, match="promises 500 points, it holds 0"):
        load(tmp_path, "a.ply", content[: -500 * row.itemsize - 5])


@pytest.mark.parametrize("how", [{"text": True}, {"byte_order": "<"}, {"byte_order": ">"}])
def test_plyfile_writes_it_and_it_reads_the_same(tmp_path: Path, how: dict[str, Any]) -> None:
    vertices = np.zeros(500, [(name, "f4") for name in ("nx", "ny", "nz", "x", "y", "z")] + [("red", "u1")])
    for name, column in zip(("x", "y", "z", "nx", "ny", "nz"), np.hstack([POINTS, NORMALS]).T, strict=True):
        vertices[name] = column
    faces = np.empty(3, [("vertex_indices", "O")])
    faces["vertex_indices"] = [np.arange(n) for n in (3, 4, 5)]
    elements = [plyfile().PlyElement.describe(faces, "face"), plyfile().PlyElement.describe(vertices, "vertex")]
    plyfile().PlyData(elements[::-1], comments=["any"], **how).write(tmp_path / "a.ply")
    scan = load_scan(tmp_path / "a.ply")
    np.testing.assert_array_equal(scan.points_mm, POINTS)
    np.testing.assert_array_equal(scan.normals, NORMALS.astype(np.float32))


@pytest.mark.parametrize("normals", [None, NORMALS])
def test_it_writes_the_bytes_that_plyfile_writes(tmp_path: Path, normals: NDArray | None) -> None:
    write_scan(tmp_path / "ours.ply", Scan("ours", POINTS, normals))
    columns = POINTS if normals is None else np.hstack([POINTS, normals])
    names = ("x", "y", "z", "nx", "ny", "nz")[: columns.shape[1]]
    table = np.rec.fromarrays(columns.astype("<f4").T, names=list(names)).view(np.ndarray)
    vertices = table.astype([(name, "<f4") for name in names])
    plyfile().PlyData([plyfile().PlyElement.describe(vertices, "vertex")], byte_order="<").write(
        tmp_path / "plyfile.ply"
    )
    assert (tmp_path / "ours.ply").read_bytes() == (tmp_path / "plyfile.ply").read_bytes()


@pytest.mark.parametrize(
    ("head", "said"),
    [
        ("element face 99999999999999999\n" + VERTEX, "promises 500 points, it holds 0"),
        ("element face 99999999999999999\nproperty list uchar int ids\n" + VERTEX, "lists stand before"),
        (VERTEX.replace("500", "9" * 18), "promises 999999999999999999 points"),
        (VERTEX.replace("500", "-5"), "number of points"),
        (VERTEX.replace("500", "9" * 19), "number of points"),
        ("comment " + "x" * 70_000, "no end_header"),
        (VERTEX + "\nproperty float x" * 3_000, "promises 500 points, it holds 0"),
    ],
)
@pytest.mark.parametrize("order", ["ascii", "binary_little_endian"])
@pytest.mark.timeout(20)
def test_a_header_that_claims_too_much_takes_neither_time_nor_memory(
    tmp_path: Path, head: str, said: str, order: str
) -> None:
    content = ply("\n", order, head, b"\xff\xff\xff\x7f")
    with pytest.raises(ScanError, match=said if order != "ascii" else None) as caught:
        load(tmp_path, "a.ply", content)
    assert len(str(caught.value)) < len(str(tmp_path)) + 400


@pytest.mark.parametrize("data", ["ascii", "binary"])
def test_an_organised_pcd_with_fields_of_several_values(tmp_path: Path, data: str) -> None:
    header = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS _ z hist y x\nSIZE 1 8 2 4 4\nTYPE U F I F F\nCOUNT 4 1 3 1 1\n"
        f"WIDTH 50\nHEIGHT 10\nVIEWPOINT 0 0 0 1 0 0 0\nDATA {data}\n"
    )
    row = np.dtype([("_", "u1", 4), ("z", "<f8"), ("hist", "<i2", 3), ("y", "<f4"), ("x", "<f4")])
    table = np.zeros(500, row)
    for name, column in zip("xyz", POINTS.T, strict=True):
        table[name] = column
    table["z"][::10] = np.nan
    body = table.tobytes()
    if data == "ascii":
        body = "\n".join(f"1 2 3 4 {r['z']} 7 8 9 {r['y']} {r['x']}".replace("nan", "-nan") for r in table).encode()
    scan = load(tmp_path, "a.pcd", header.encode() + body)
    assert scan.dropped == 50
    np.testing.assert_allclose(scan.points_mm, np.delete(POINTS, np.s_[::10], axis=0), rtol=1e-6)


@pytest.mark.slow
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(values=st.lists(st.integers(0, 3), min_size=1, max_size=300), stride=st.integers(1, 9))
def test_compressed_clouds_that_repeat_themselves(tmp_path: Path, values: list[int], stride: int) -> None:
    """Few values in a row make long and overlapping repeats. Open3D packs them, our reader unpacks them."""
    import open3d

    points = np.repeat(np.array(values, dtype=np.float64), stride)[:, None] * [1.0, 2.0, 0.0] + [1, 0, 0]
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    open3d.io.write_point_cloud(str(tmp_path / "r.pcd"), cloud, compressed=True)
    np.testing.assert_array_equal(load_scan(tmp_path / "r.pcd").points_mm, points)


# ---- text ----------------------------------------------------------------------------------------------------------

TWO = [[1.5, -2, 3e2], [4, 5, 6]]


@pytest.mark.parametrize(
    "text",
    [
        "1.5 -2 3e2\n4 5 6\n",
        "  1.5   -2 3e2 255 0\r\n  4 5 6 255\r\n\r\n",
        "1.5\t-2\t3e2\n4\t5\t6",
        "1.5\t-2\t3e2\t\n4\t5\t6\t\n",
        "1.5,-2,3e2\n4,5,6\n",
        "1.5, -2, 3e2, 17\n4, 5, 6, 18\n",
        "1.5;-2;3e2\n4;5;6\n",
        "1,5;-2,0;3e2\n4,0;5,0;6,0\n",
        "1,5 -2,0 3,0e2\n4,0 5,0 6,0\n",
        "1.5|-2|3e2\n4|5|6\n",
        "# made by a scanner\n# 2 points\n1.5 -2 3e2\n# and\n4 5 6\n",
        "x y z\n1.5 -2 3e2\n4 5 6\n",
        "X,Y,Z\n1.5,-2,3e2\n4,5,6\n",
        '"x_mm","y_mm","z_mm"\n"1.5","-2","3e2"\n"4","5","6"\n',
        "z [mm];q;Y [mm];X (mm)\n3e2;9;-2;1.5\n6;9;5;4\n",
        "//X,Y,Z,R,G,B\n1.5,-2,3e2,1,2,3\n4,5,6,1,2,3\n",
        "# id x y z\n7 1.5 -2 3e2\n8 4 5 6\n",
        "# x = right, in mm\n1.5 -2 3e2\n4 5 6\n",
        "\ufeffx,y,z\n1.5,-2,3e2\n4,5,6\n",
    ],
)
@pytest.mark.parametrize("suffix", [".xyz", ".csv", ".txt"])
def test_text_however_it_is_delimited(tmp_path: Path, text: str, suffix: str) -> None:
    scan = load(tmp_path, f"a{suffix}", text)
    np.testing.assert_array_equal(scan.points_mm, TWO)
    assert scan.normals is None


@pytest.mark.parametrize(
    "empty",
    [
        "7,8,nan", "7,8,NaN", "7,8,", ",,", "7,,9", ",8,9", "7, ,9", "7,8,-nan(ind)", "7,8,-1.#IND", "7,8,inf",
        "7,8,N/A",
        "7,8,3.4028235e38", "7,8,null",
    ],
)  # fmt: skip
def test_text_without_a_value(tmp_path: Path, empty: str) -> None:
    scan = load(tmp_path, "a.csv", f"x,y,z\n1.5,-2,3e2\n{empty}\n4,5,6\n")
    np.testing.assert_array_equal(scan.points_mm, TWO)
    assert scan.dropped == 1


@pytest.mark.parametrize("text", ["1 2 3\n4 5\n", "1 2 3\n4 5 six\n", "x y z\nx y z\n", "1 2\n3 4\n", "a b\n1 2"])
def test_text_that_is_no_table_of_points(tmp_path: Path, text: str) -> None:
    with pytest.raises(ScanError, match=r"no x, y, z|not three numbers"):
        load(tmp_path, "a.txt", text)


def test_pandas_writes_it_with_normals_in_any_order(tmp_path: Path) -> None:
    frame = pd.DataFrame({"nz": NORMALS[:, 2], "intensity": 1.0, "z": POINTS[:, 2], "name": "p", "x": POINTS[:, 0]})
    frame = frame.assign(nx=NORMALS[:, 0], ny=NORMALS[:, 1], y=POINTS[:, 1])
    frame.loc[3, "x"] = np.nan
    frame.to_csv(tmp_path / "a.csv", index=False)
    scan = load_scan(tmp_path / "a.csv")
    np.testing.assert_array_equal(scan.points_mm, np.delete(POINTS, 3, axis=0))
    np.testing.assert_array_equal(scan.normals, np.delete(NORMALS, 3, axis=0))
    assert scan.dropped == 1


# ---- meshes and archives -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".stl", ".stl_ascii", ".obj", ".ply"])
def test_trimesh_writes_it_and_its_vertices_are_read(tmp_path: Path, suffix: str) -> None:
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=2, radius=40.0)
    path = tmp_path / f"a{suffix[:4]}"
    mesh.export(path, file_type=suffix[1:])
    points = load_scan(path).points_mm
    assert len(points) == len(mesh.vertices)

    def ordered(rows: NDArray) -> NDArray:
        return rows[np.lexsort(np.round(rows, 3).T)]

    np.testing.assert_allclose(ordered(points), ordered(mesh.vertices), atol=1e-5)
    whole = path.read_bytes()
    if suffix.startswith(".stl"):
        with pytest.raises(ScanError, match=r"truncated|cut short"):
            load(tmp_path, "a.stl", whole[: len(whole) // 2])


@pytest.mark.parametrize("name", ["points", "points_mm"])
@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("dtype", ["<f4", ">f8", "<i2"])
def test_numpy_archives(tmp_path: Path, name: str, packed: bool, dtype: str) -> None:
    points = np.round(POINTS).astype(dtype)
    save = np.savez_compressed if packed else np.savez
    save(tmp_path / "a.npz", **{name: np.asfortranarray(points), "normals": NORMALS, "colours": points})
    scan = load_scan(tmp_path / "a.npz")
    np.testing.assert_array_equal(scan.points_mm, np.round(POINTS))
    np.testing.assert_array_equal(scan.normals, NORMALS)
    save(tmp_path / "b.npz", **{name: points.reshape(25, 20, 3)})
    np.testing.assert_array_equal(load_scan(tmp_path / "b.npz").points_mm, np.round(POINTS))


@pytest.mark.parametrize("dtype", ["<f4", ">f8", "<i2"])
def test_numpy_arrays(tmp_path: Path, dtype: str) -> None:
    points = np.round(POINTS).astype(dtype)
    for array in (points, np.asfortranarray(points), points.reshape(25, 20, 3)):
        np.save(tmp_path / "a.npy", array)
        np.testing.assert_array_equal(load_scan(tmp_path / "a.npy").points_mm, np.round(POINTS))
    np.save(tmp_path / "a.npy", POINTS[:, :2])
    with pytest.raises(ScanError, match="save numbers of shape"):
        load_scan(tmp_path / "a.npy")
    with pytest.raises(ScanError, match=r"not a readable \.npy"):
        load(tmp_path, "b.npy", b"no array at all")


@pytest.mark.parametrize(("version", "point_format", "more"), [(0, 0, 8), (2, 3, 22), (4, 6, 18), (4, 10, 55)])
def test_las_files(tmp_path: Path, version: int, point_format: int, more: int) -> None:
    whole = las(POINTS, version=version, point_format=point_format, more=more)
    np.testing.assert_allclose(load(tmp_path, "a.las", whole).points_mm, POINTS, atol=6e-6)
    with pytest.raises(ScanError, match=f"promises {len(POINTS)} points, it holds {len(POINTS) - 1}"):
        load(tmp_path, "b.las", whole[:-1])
    with pytest.raises(ScanError, match=r"not a readable \.las"):
        load(tmp_path, "d.las", b"LASF")


@pytest.mark.parametrize(("version", "point_format", "size"), [(2, 0, 20), (2, 3, 34), (4, 6, 30), (4, 7, 36)])
def test_compressed_las_files(tmp_path: Path, version: int, point_format: int, size: int) -> None:
    lazrs = pytest.importorskip("lazrs")
    plain = las(POINTS, version=version, point_format=point_format, more=size - 12)
    first = len(plain) - size * len(POINTS)
    record = lazrs.LazVlr.new_for_compression(point_format, 0)
    how = bytes(record.record_data())
    header = bytearray(plain[:first])
    begin = first + 54 + len(how)
    struct.pack_into("<HIIB", header, 94, first, begin, 1, 0x80 | point_format)
    described = struct.pack("<2x16sHH32x", b"laszip encoded", 22204, len(how)) + how
    # The first eight bytes say where in the file the table of chunks is.
    packed = bytearray(lazrs.compress_points(record, np.frombuffer(plain[first:], np.uint8), False))
    struct.pack_into("<q", packed, 0, struct.unpack_from("<q", packed)[0] + begin)
    whole = bytes(header) + described + bytes(packed)
    np.testing.assert_allclose(load(tmp_path, "a.laz", whole).points_mm, POINTS, atol=6e-6)
    for damaged in (whole[: len(whole) // 2], bytes(header) + described[:30], whole[:begin] + bytes(200)):
        with pytest.raises(ScanError, match=r"not a readable \.las"):
            load(tmp_path, "b.laz", damaged)


def test_las_files_without_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "laspy", None)
    with pytest.raises(ScanError, match=r"robot-calibration-inspector\[laz\]"):
        load(tmp_path, "c.laz", las(POINTS))


def npy_claiming(shape: str, kind: str = "<f8") -> bytes:
    header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}}}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode() + bytes(48)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (npy_claiming("(1000000000000, 3)"), "promises 1000000000000 points, it holds 2"),
        (npy_claiming("(2, 4)"), "shape"),
        (npy_claiming("(6,)"), "shape"),
        (npy_claiming("(2, 3)", "|O"), "object"),
        (b"\x93NUMPY", "not a readable .npz"),
        (b"", "not a readable .npz"),
    ],
)
def test_archives_that_claim_too_much(tmp_path: Path, content: bytes, said: str) -> None:
    file = BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("points.npy", content)
    with pytest.raises(ScanError, match=said):
        load(tmp_path, "a.npz", file.getvalue())


def test_archives_without_points_or_with_too_few_normals(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", colours=POINTS)
    with pytest.raises(ScanError, match="found: colours"):
        load_scan(tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz", points=POINTS, normals=NORMALS[:9])
    with pytest.raises(ScanError, match="500 points and 9 normals"):
        load_scan(tmp_path / "a.npz")


def test_pixels_at_the_scanners_own_place_have_no_depth(tmp_path: Path) -> None:
    organised = np.zeros((10, 50, 3))
    organised[2:5] = POINTS[:150].reshape(3, 50, 3)
    np.savez(tmp_path / "a.npz", points=organised)
    scan = load_scan(tmp_path / "a.npz")
    np.testing.assert_array_equal(scan.points_mm, POINTS[:150])
    assert scan.dropped == 350
    assert load(tmp_path, "b.xyz", "0 0 0\n1 2 3\n").dropped == 0  # one alone may be a point


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.filterwarnings("error")
def test_a_nan_that_signals_is_a_nan(tmp_path: Path, order: str) -> None:
    """The bits of a signalling NaN make numpy warn wherever it converts them."""
    signalling = (0x7FF0000000000001).to_bytes(8, {"<": "little", ">": "big"}[order])
    body = (POINTS[:4].astype(order + "f8").tobytes() + signalling * 3) * 2
    kind = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    elements = "element vertex 10\nproperty double x\nproperty double y\nproperty double z"
    scan = load(tmp_path, "a.ply", ply("\n", kind, elements, body))
    assert scan.dropped == 2
    np.testing.assert_array_equal(scan.points_mm, np.vstack([POINTS[:4]] * 2))
