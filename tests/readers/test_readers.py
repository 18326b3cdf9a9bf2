"""Each file format gives the same data back as was written."""

from __future__ import annotations

import imagecodecs
import meshio
import numpy as np
import pytest
import tifffile
from PIL import Image

from experiment_file.small_experiment import inp_text
from idic.errors import InputError
from idic.experiment_file.tables.mesh_sets import with_node_set
from idic.readers import Log, frames_of, matching_files, natural_key, open_stack, read_mesh_file, recorded_order

PIXELS = np.arange(6 * 8, dtype=np.uint8).reshape(6, 8) * 5


# images -------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("dtype, options", [
    (np.uint8, {}), (np.uint16, {}), (np.float32, {}), (np.uint8, {"compression": "deflate", "predictor": True}),
    (np.uint16, {"compression": "lzw"}), (np.uint16, {"byteorder": ">"}), (np.uint8, {"tile": (16, 16)}),
])
def test_a_tiff_comes_back_pixel_by_pixel(dtype, options, tmp_path):
    pixels = (PIXELS.astype(np.float64) * (257 if dtype == np.uint16 else 1)).astype(dtype)
    tifffile.imwrite(tmp_path / "a.tif", pixels, photometric="minisblack", **options)
    stack = open_stack([tmp_path / "a.tif"])
    assert stack.shape == (6, 8) and stack.n_frames == 1
    frame = stack.frame(0)
    assert frame.dtype == dtype
    np.testing.assert_array_equal(frame, pixels)


def test_doubles_become_single_precision(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", PIXELS.astype(np.float64))
    assert open_stack([tmp_path / "a.tif"]).frame(0).dtype == np.float32


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_png_comes_back_pixel_by_pixel(dtype, tmp_path):
    pixels = PIXELS.astype(dtype) * (257 if dtype == np.uint16 else 1)
    Image.fromarray(pixels).save(tmp_path / "a.png")
    frame = open_stack([tmp_path / "a.png"]).frame(0)
    assert frame.dtype == dtype
    np.testing.assert_array_equal(frame, pixels)


def test_every_page_of_a_tiff_is_a_frame(tmp_path):
    pages = np.stack([PIXELS, PIXELS + 1, PIXELS + 2])
    tifffile.imwrite(tmp_path / "movie.tif", pages, photometric="minisblack")
    stack = open_stack([tmp_path / "movie.tif"])
    assert stack.n_frames == 3 and stack.labels[2] == "movie.tif[2]"
    for k in range(3):
        np.testing.assert_array_equal(stack.frame(k), pages[k])


def test_a_grey_palette_and_equal_channels_are_grey(tmp_path):
    ramp = np.tile(np.arange(256, dtype=np.uint16) * 257, (3, 1))
    tifffile.imwrite(tmp_path / "palette.tif", PIXELS, photometric="palette", colormap=ramp)
    tifffile.imwrite(tmp_path / "rgb.tif", np.stack([PIXELS] * 3, axis=-1), photometric="rgb")
    Image.fromarray(np.stack([PIXELS] * 3, axis=-1)).save(tmp_path / "rgb.png")
    for name in ("palette.tif", "rgb.tif", "rgb.png"):
        np.testing.assert_array_equal(open_stack([tmp_path / name]).frame(0), PIXELS)


@pytest.mark.parametrize("channels", [2, 3, 4])
def test_sixteen_bits_in_equal_channels_of_a_png_stay_sixteen(tmp_path, channels):
    deep = (PIXELS.astype(np.uint16) << 4) + 5
    image = np.stack([deep] * channels, axis=-1)
    (tmp_path / "a.png").write_bytes(imagecodecs.png_encode(image))
    stack = open_stack([tmp_path / "a.png"])
    assert stack.entries[0].dtype == "uint16"
    np.testing.assert_array_equal(stack.frame(0), deep)
    if channels == 3:
        image[1, 2, 1] += 1  # colour that the upper 8 bits do not show
        (tmp_path / "a.png").write_bytes(imagecodecs.png_encode(image))
        with pytest.raises(InputError, match="colour"):
            open_stack([tmp_path / "a.png"])


def test_a_coloured_palette_and_a_coloured_png_are_refused(tmp_path):
    ramp = np.zeros((3, 256), np.uint16)
    ramp[0] = np.arange(256) * 257
    tifffile.imwrite(tmp_path / "palette.tif", PIXELS, photometric="palette", colormap=ramp)
    Image.fromarray(np.stack([PIXELS, PIXELS, PIXELS // 2], axis=-1)).save(tmp_path / "rgb.png")
    for name in ("palette.tif", "rgb.png"):
        with pytest.raises(InputError, match=": .*colour"):
            open_stack([tmp_path / name])


@pytest.mark.parametrize("name", ["a.png", "a.tif"])
def test_an_image_cut_anywhere_is_refused_or_read_whole(name, tmp_path):
    if name == "a.png":
        Image.fromarray(PIXELS).save(tmp_path / name)
    else:
        tifffile.imwrite(tmp_path / name, PIXELS, compression="deflate")
    data = (tmp_path / name).read_bytes()
    for length in range(0, len(data), 7):
        (tmp_path / name).write_bytes(data[:length])
        try:
            frame = open_stack([tmp_path / name]).frame(0)
        except InputError as error:
            assert error.remedy and name in str(error.file)
        else:  # only bytes after the pixels are missing
            np.testing.assert_array_equal(frame, PIXELS)


def test_a_height_map_keeps_its_values_and_its_gaps(tmp_path):
    heights = PIXELS.astype(np.float32)
    heights[1, 2], heights[2, 3] = np.nan, np.inf
    tifffile.imwrite(tmp_path / "a.tif", heights)
    frame = open_stack([tmp_path / "a.tif"], with_gaps=True).frame(0)
    heights[2, 3] = np.nan  # an overflow of the instrument is a gap too
    np.testing.assert_array_equal(frame, heights)
    with pytest.raises(InputError, match="without a value"):
        open_stack([tmp_path / "a.tif"]).frame(0)


def test_files_are_sorted_as_people_count(tmp_path):
    for name in ("f_10.tif", "f_2.tif", "f_1.tif"):
        tifffile.imwrite(tmp_path / name, PIXELS)
    assert [p.name for p in matching_files(tmp_path, ["*.tif"], file=None,
                                           key=None)] == ["f_1.tif", "f_2.tif", "f_10.tif"]
    assert natural_key("a2b10") < natural_key("a10b2")


def test_decimal_numbers_in_file_names_are_sorted_by_value_or_refused(tmp_path):
    def order(*names):
        return [path.name for path in recorded_order([tmp_path / name for name in names], tmp_path)]

    with pytest.raises(InputError, match="order of the files") as caught:
        order("t_1.0s.tif", "t_1.25s.tif", "t_1.5s.tif", "reference.tif")
    assert "t_1.5s.tif and t_1.25s.tif" in caught.value.found
    assert order("t_1.50s.tif", "t_1.25s.tif", "t_1.00s.tif") == ["t_1.00s.tif", "t_1.25s.tif", "t_1.50s.tif"]
    assert order("t_10.5s.tif", "t_9.5s.tif")[0] == "t_9.5s.tif"
    counted = [f"specimen_1.{k}.tif" for k in range(8, 12)]  # a counter behind a point
    assert order(*reversed(counted)) == counted
    assert order("a_1.5_2.tif", "b_1.25_3.tif", "2024.10.1.tif", "2024.9.1.tif")[0] == "2024.9.1.tif"  # not alike


@pytest.mark.parametrize("names, first", [
    (["L1.tif", "L3.tif", "Sample14_Reference.tif"], "Sample14_Reference.tif"), (["a_1.tif", "x ref.tif"], "x ref.tif"),
    (["refined_2.tif", "a_1.tif"], "a_1.tif"), (["ref_2.tif", "ref_1.tif"], "ref_1.tif")])
def test_the_one_file_that_is_called_the_reference_comes_first(names, first, tmp_path):
    assert recorded_order([tmp_path / name for name in names], tmp_path)[0].name == first


def test_the_brackets_in_the_name_of_a_folder_or_a_file_are_no_class_of_letters(tmp_path):
    for name in ("data [2]/right_0.tif", "data [2]/right_1.tif", "data 2/wrong_0.tif", "movie [1].tif", "movie 1.tif"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        tifffile.imwrite(tmp_path / name, PIXELS)
    right = ("right_0.tif", "right_1.tif")
    for pattern in ("data [2]/*.tif", "data [[]2]/*.tif", "data [[]2]/right_[0-9].tif"):
        found = matching_files(tmp_path, [pattern], file=None, key=None)
        assert tuple(path.name for path in found) == right
        assert frames_of(str(tmp_path / pattern)).labels == right
    assert frames_of(tmp_path / "data [2]").labels == right
    assert matching_files(tmp_path, ["movie [1].tif"], file=None, key=None) == [tmp_path / "movie [1].tif"]
    assert len(matching_files(tmp_path, ["data [0-9]/*.tif"], file=None, key=None)) == 1


# log ----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("content", [
    "frame,time_s,force_N\n0,0,1.5\n1,2,2.5\n", "# made by a machine\nframe;time_s;force_N\n0;0;1,5\n1;2;2,5\n",
    "\ufeffframe\ttime_s\tforce_N\n0\t0\t1.5\n1\t2\t2.5\n\n",
])
def test_logs_with_comma_semicolon_and_tab_read_alike(content, tmp_path):
    (tmp_path / "log.csv").write_text(content, encoding="utf-8")
    log = Log.read(tmp_path / "log.csv")
    np.testing.assert_array_equal(log.column("force_N"), [1.5, 2.5])
    np.testing.assert_array_equal(log.times(), [0.0, 2.0])


def test_a_log_is_interpolated_at_the_times_of_the_images(tmp_path):
    (tmp_path / "log.csv").write_text("time_ms,force_N\n" + "".join(f"{100 * k},{3 * k}\n" for k in range(21)))
    matched = Log.read(tmp_path / "log.csv").match(3, None, np.array([0.0, 0.55, 2.0]))
    np.testing.assert_allclose(matched.column("force_N"), [0.0, 16.5, 60.0], rtol=1e-12)  # linear: exact to rounding
    np.testing.assert_array_equal(matched.times, [0.0, 0.55, 2.0])


def test_the_frame_column_may_hold_the_numbers_of_the_file_names(tmp_path):
    (tmp_path / "log.csv").write_text("frame,force_N\n50,1\n53,2\n")
    log = Log.read(tmp_path / "log.csv")
    np.testing.assert_array_equal(log.match(2, (50, 53), None).column("force_N"), [1.0, 2.0])
    with pytest.raises(InputError, match="frame column"):
        log.match(2, (50, 54), None)


def test_text_in_an_unused_column_does_no_harm(tmp_path):
    (tmp_path / "log.csv").write_text("force_N,remark\n1,start\n2,\n")
    np.testing.assert_array_equal(Log.read(tmp_path / "log.csv").column("force_N"), [1.0, 2.0])


# mesh ---------------------------------------------------------------------------------------------------
def read(path, n_dim=2, factor=1.0):
    mesh, _ = read_mesh_file(path).to_mesh(n_dim, factor)
    mesh.check_elements()
    return mesh


@pytest.mark.parametrize("element_type", ["CPS4", "CPE4", "CPS4R", "CPE4H", "CAX4P"])
def test_an_abaqus_file_keeps_labels_and_sets(element_type, tmp_path):
    (tmp_path / "mesh.inp").write_text(inp_text(element_type))
    mesh = read(tmp_path / "mesh.inp")
    assert (mesh.n_nodes, mesh.n_elements, mesh.n_dim) == (20, 12, 2)
    assert mesh.node_labels[mesh.node_sets["BOTTOM"]].tolist() == [101, 102, 103, 104, 105]
    assert mesh.node_labels[mesh.node_sets["TOP"]].tolist() == [116, 117, 118, 119, 120]
    assert mesh.element_labels[mesh.element_sets["LAST"]].tolist() == [1004, 1008, 1012]
    assert {tuple(sorted(mesh.node_labels[mesh.face_nodes(face)])) for face in mesh.edge_sets["RIGHT"]} \
        == {(105, 110), (110, 115), (115, 120)}


def test_an_abaqus_file_agrees_with_meshio(tmp_path):
    (tmp_path / "mesh.inp").write_text(inp_text())
    mesh, other = read(tmp_path / "mesh.inp"), meshio.read(tmp_path / "mesh.inp")
    np.testing.assert_array_equal(mesh.nodes, other.points[:, :2])
    np.testing.assert_array_equal(mesh.blocks[0].connectivity, other.cells_dict["quad"])


CAE = """*Part, name=Part-1
*Node
1, 0., 0.
2, 1., 0.
3, 1., 1.
4, 0., 1.
5, 2., 0.
6, 2., 1.
*Element, type=CPS4R
1, 1,2,3,4
2, 2,5,6,3
*Nset, nset=Set-1, generate
1, 6, 1
*Elset, elset=Set-1
1, 2
*Nset, nset=Same
1
*Elset, elset=Hold
1
*End Part
*Assembly, name=Assembly
*Instance, name=Part-1-1, part=Part-1
*End Instance
*Nset, nset=Set-1, instance=Part-1-1
1
*Nset, nset=Set-1, instance=Part-1-1
4
*Nset, nset=Same, instance=Part-1-1
1
*Nset, nset=Hold, instance=Part-1-1
5, 6
*Nset, nset=Both, instance=Part-1-1
Set-1, 5
*Elset, elset=_Edge_S1, instance=Part-1-1
1
*Surface, type=ELEMENT, name=Edge
_Edge_S1, S1
*End Assembly
"""


def test_a_part_and_the_assembly_may_have_sets_of_one_name(tmp_path):
    (tmp_path / "mesh.inp").write_text(CAE)
    raw = read_mesh_file(tmp_path / "mesh.inp")
    assert {name: (1 + ids).tolist() for name, ids in raw.node_sets.items()} == {
        "Part-1_Set-1": [1, 2, 3, 4, 5, 6], "Assembly_Set-1": [1, 4], "Same": [1], "Hold": [5, 6], "Both": [1, 4, 5]}
    assert {name: ids.tolist() for name, ids in raw.element_sets.items()} == {
        "Part-1_Set-1": [0, 1], "Hold": [0], "_Edge_S1": [0]}
    with pytest.raises(InputError, match="no such set") as caught:
        with_node_set(read(tmp_path / "mesh.inp"), "Set-1", "experiment.toml", "boundary[0].nodes")
    assert "write Assembly_Set-1 or Part-1_Set-1" in caught.value.remedy


@pytest.mark.parametrize("more", ["*NGEN\n1, 4\n", "*ELGEN\n1, 2, 1\n", "*NCOPY, CHANGE NUMBER=10\n",
                                  "*ELCOPY\n", "*NFILL\n", "*NODE, SYSTEM=S\n9, 1., 90.\n",
                                  "*INSTANCE, NAME=A, LIBRARY=job\n"])
def test_nodes_and_elements_that_a_rule_makes_are_refused(tmp_path, more):
    (tmp_path / "mesh.inp").write_text(inp_text() + more)
    with pytest.raises(InputError, match=r"line \d+") as caught:
        read_mesh_file(tmp_path / "mesh.inp")
    assert "orphan mesh" in caught.value.remedy
    (tmp_path / "mesh.inp").write_text(inp_text() + "*SYSTEM\n*NODE, SYSTEM=R\n999, 1., 1.\n")
    assert len(read_mesh_file(tmp_path / "mesh.inp").nodes) == 21


def test_sets_of_sets_and_dangling_nodes_are_understood(tmp_path):
    text = inp_text() + "*NSET, NSET=ENDS\nTOP, BOTTOM\n*NODE, NSET=REF\n999, 50., 50., 0.\n"
    text += "*MATERIAL, NAME=X\n*ELASTIC\n1., 0.3\n"
    (tmp_path / "mesh.inp").write_text(text)
    mesh = read(tmp_path / "mesh.inp")
    assert len(mesh.node_sets["ENDS"]) == 10 and "REF" not in mesh.node_sets and 999 not in mesh.node_labels


def test_quadratic_elements_and_solids_are_read(tmp_path):
    corners = [(0, 0), (1, 0), (1, 1), (0, 1), (0.5, 0), (1, 0.5), (0.5, 1), (0, 0.5)]
    nodes = "".join(f"{k + 1}, {x}, {y}\n" for k, (x, y) in enumerate(corners))
    (tmp_path / "q8.inp").write_text(f"*NODE\n{nodes}*ELEMENT, TYPE=CPE8R, ELSET=A\n7, 1,2,3,4,\n5,6,7,8\n")
    mesh = read(tmp_path / "q8.inp")
    assert mesh.blocks[0].cell == "quad8" and mesh.element_labels.tolist() == [7]
    cube = "".join(f"{4 * k + j + 1}, {x}, {y}, {k}\n" for k in range(2) for j, (x, y) in enumerate(corners[:4]))
    elements = "*ELEMENT, TYPE=C3D8, ELSET=A\n1, 1,2,3,4,5,6,7,8\n*SURFACE, NAME=FRONT\n1, S2\n"
    (tmp_path / "h8.inp").write_text(f"*NODE\n{cube}{elements}")
    solid = read(tmp_path / "h8.inp", 3)
    assert solid.blocks[0].cell == "hex8"
    assert solid.nodes[solid.face_nodes(solid.edge_sets["FRONT"][0])][:, 2].tolist() == [1.0] * 4


def gmsh_mesh():
    points = np.array([[x, y, 0.0] for y in (0.0, 1.0) for x in (0.0, 1.0, 2.0)])
    cells = [("line", np.array([[0, 1], [1, 2]])), ("quad", np.array([[0, 1, 4, 3], [1, 2, 5, 4]]))]
    tags = [np.array([7, 7]), np.array([1, 2])]
    return meshio.Mesh(points, cells, cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
                       field_data={"BASE": np.array([7, 1]), "SOFT": np.array([1, 2])})


def test_gmsh_physical_groups_are_sets(tmp_path):
    meshio.write(tmp_path / "mesh.msh", gmsh_mesh(), file_format="gmsh22", binary=False)
    mesh = read(tmp_path / "mesh.msh", factor=1000.0)
    assert mesh.element_sets["SOFT"].tolist() == [0] and mesh.element_sets["physical_2"].tolist() == [1]
    assert mesh.node_sets["BASE"].tolist() == [0, 1, 2] and len(mesh.edge_sets["BASE"]) == 2
    assert mesh.element_labels.tolist() == [3, 4]  # the lines are elements 1 and 2 of the file
    assert mesh.nodes.max() == 2000.0


@pytest.mark.parametrize("name", ["mesh.vtu", "mesh.vtk"])
def test_integer_arrays_of_a_vtk_file_are_sets(name, tmp_path):
    mesh = gmsh_mesh()
    meshio.Mesh(mesh.points, mesh.cells[1:], point_data={"TOP": np.array([0, 0, 0, 1, 1, 1]),
                                                         "speed": np.linspace(0, 1, 6)},
                cell_data={"part": [np.array([3, 5])]}).write(tmp_path / name)
    read_back = read(tmp_path / name)
    assert read_back.node_sets["TOP"].tolist() == [3, 4, 5] and set(read_back.node_sets) == {"TOP"}
    assert read_back.element_sets["part_3"].tolist() == [0] and read_back.element_sets["part_5"].tolist() == [1]


def test_groups_of_a_med_file_are_sets(tmp_path):
    """Salome numbers families; a node or element of several groups is in a family of its own."""
    mesh = gmsh_mesh()
    written = meshio.Mesh(mesh.points, mesh.cells, point_data={"point_tags": np.array([0, 0, 0, 2, 2, 2])},
                          cell_data={"cell_tags": [np.array([-8, -8]), np.array([-6, -7])]})
    written.point_tags, written.cell_tags = {2: ["TOP"]}, {-6: ["ALL", "SOFT"], -7: ["ALL"], -8: ["BASE"]}
    meshio.write(tmp_path / "mesh.med", written)
    read_back = read(tmp_path / "mesh.med")
    assert read_back.node_sets["TOP"].tolist() == [3, 4, 5] and len(read_back.edge_sets["BASE"]) == 2
    assert {name: ids.tolist() for name, ids in read_back.element_sets.items()} == {"ALL": [0, 1], "SOFT": [0]}


@pytest.mark.parametrize("properties", [(11, 12), (1, 2)])
def test_properties_of_a_nastran_file_are_sets(tmp_path, properties):
    mesh = gmsh_mesh()
    grid = [f"GRID,{100 + k},,{x},{y},0.0" for k, (x, y, _) in enumerate(mesh.points)]
    quads = [f"CQUAD4,{k + 1},{properties[k]},{','.join(str(100 + i) for i in cell)}"
             for k, cell in enumerate(mesh.cells[1].data)]
    (tmp_path / "mesh.bdf").write_text("\n".join(["SOL 101", "CEND", "BEGIN BULK", *grid, *quads, "ENDDATA", ""]))
    read_back = read(tmp_path / "mesh.bdf")
    assert {name: ids.tolist() for name, ids in read_back.element_sets.items()} == {
        f"property_{properties[0]}": [0], f"property_{properties[1]}": [1]}


def test_a_mirrored_mesh_is_turned_around_and_keeps_its_edges(tmp_path):
    text = inp_text()
    for j in range(4):
        for i in range(5):
            text = text.replace(f"{101 + 5 * j + i}, {float(i)}, {float(j)},",
                                f"{101 + 5 * j + i}, {-float(i)}, {float(j)},")
    (tmp_path / "mesh.inp").write_text(text)
    raw = read_mesh_file(tmp_path / "mesh.inp")
    mesh, notes = raw.to_mesh(2, 1.0)
    mesh.check_elements()
    assert any("clockwise" in note for note in notes)
    assert {tuple(sorted(mesh.node_labels[mesh.face_nodes(face)])) for face in mesh.edge_sets["RIGHT"]} \
        == {(105, 110), (110, 115), (115, 120)}


def test_a_set_by_position_does_not_stop_the_only_material_from_meaning_all_elements(tmp_path):
    """A wide band of nodes holds whole elements too; it is still no element set of the mesh."""
    from idic.experiment_file.tables.mesh_sets import with_element_set, with_sets
    from idic.experiment_file.schema.boundary import SetTable
    from idic.fe import make_mesh

    nodes = np.array([[x, y] for y in range(3) for x in range(4)], float)
    quads = np.array([[i + 4 * j, i + 1 + 4 * j, i + 5 + 4 * j, i + 4 + 4 * j] for j in range(2) for i in range(3)])
    mesh = with_sets(make_mesh(nodes, [("quad4", quads)]), {"WIDE": SetTable(where="x < 2.5")}, 1.0, "experiment.toml")
    assert len(mesh.element_sets["WIDE"])
    mesh, note = with_element_set(mesh, "SHEET", True, "experiment.toml", "material.SHEET", ["WIDE"])
    assert len(mesh.element_sets["SHEET"]) == mesh.n_elements and "all elements" in note
