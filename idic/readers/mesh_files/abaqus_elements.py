"""Element types of Abaqus and CalculiX: the cell, the order of its nodes, and what its face numbers mean."""

from __future__ import annotations

import re

from idic.fe import cell_type, CELL_TYPES
from idic.input_decks import first_edge, is_sheet

N_NODES = {"tet4": 4, "wedge6": 6, "hex8": 8, "tet10": 10, "wedge15": 15, "hex20": 20, "hex27": 27, "pyramid5": 5,
           "tri3": 3, "quad4": 4, "tri6": 6, "quad8": 8, "quad9": 9, "line2": 2, "line3": 3}
_PLANE = {3: "tri3", 4: "quad4", 6: "tri6", 8: "quad8", 9: "quad9"}
_FAMILIES = (  # type name -> {number in it: cell}
    (re.compile(r"(?:C|DC|AC|Q)3D(\d+)"), {4: "tet4", 5: "pyramid5", 6: "wedge6", 8: "hex8", 10: "tet10",
                                           15: "wedge15", 20: "hex20", 27: "hex27"}),
    (re.compile(r"(?:SC|CSS)(\d)"), {6: "wedge6", 8: "hex8"}),
    (re.compile(r"STRI(\d)"), {3: "tri3", 6: "tri6"}),
    (re.compile(r"(?:CPS|CPEG|CPE|CAX|CGAX|DCAX|DC2D|AC2D|M3D|SFM3D|R3D|DS|US|S)(\d)"), _PLANE),
    (re.compile(r"(?:T2D|T3D)(\d)"), {2: "line2", 3: "line3"}),
    (re.compile(r"(?:R2D|RB2D|RB3D|RAX)(\d)"), {2: "line2"}),
    (re.compile(r"(?:B2|B3|PIPE2|PIPE3|ELBOW3|SAX|MAX|SFMAX)(\d)"), {1: "line2", 2: "line3", 3: "line2"}),
)
_KINDS = {"CPS": "plane_stress", "CPE": "plane_strain", "CAX": "axisymmetric", "CGAX": "axisymmetric"}
_NO_BODY = re.compile(r"SPRING|DASHPOT|MASS|ROTARYI|HEATCAP|CONN|COH|GAP|DGAP|ITS|ITT|JOINT|DCOUP|GK|ISL|IRS|DRAG|CIN|"
                      r"F2D|F3D|FAX|FGAP|D$|D\d*$|MCL")  # springs, masses, connectors, interfaces, networks
_SIDES = ("SPOS", "SNEG", "SP", "SN", "P", "N", "POS", "NEG")  # the two sides of a sheet or of a plane element


def cell_of(element_type: str) -> str | None:
    """The cell of a type name; None where idic does not know the type."""
    name = element_type.upper()
    if name.startswith("STRI65"):
        return "tri6"
    for pattern, cells in _FAMILIES:
        match = pattern.match(name)
        if match and int(match.group(1)) in cells:
            return cells[int(match.group(1))]
    return None


def stated_kind(element_type: str) -> str | None:
    """What the name of a plane element says of its state; None where it says nothing."""
    name = element_type.upper()
    return next((kind for start, kind in _KINDS.items() if name.startswith(start)), None)


def has_no_body(element_type: str) -> bool:
    """Whether elements of a type are no part of the meshed body: springs, masses, connectors, interfaces."""
    return _NO_BODY.match(element_type.upper()) is not None


def ordered(cell: str, nodes: list[int]) -> list[int]:
    """The nodes of an element in the order of `idic.fe`: the middle of a quadratic line comes last, not second."""
    return [nodes[0], nodes[2], nodes[1]] if cell == "line3" else nodes


def side_of_sheet(element_type: str, face: str) -> bool:
    """Whether a face of a sheet is one of its two sides, which are no edge."""
    return face.upper() in _SIDES or (is_sheet(element_type) and face.upper() in ("S1", "S2", "1", "2"))


def face_corners(element_type: str, cell: str, face: str) -> tuple[int, ...] | None:
    """The local corner nodes of a face (edge) by its name in a *SURFACE; None where there is none of this name.

    S3 of a shell is its edge 1-2, S1 of a plane element, E1 of both (Abaqus numbers the edges of shells E1 … E4).
    """
    match = re.fullmatch(r"([SE]?)([0-9])", face.upper())
    table = CELL_TYPES[cell].faces if cell in CELL_TYPES else ()
    if match is None:
        return None
    first = 1 if match.group(1) == "E" else first_edge(element_type)
    number = int(match.group(2)) - first
    return table[number][:cell_type(cell).n_face_corners] if 0 <= number < len(table) else None


def face_names(element_type: str, cell: str) -> str:
    """The names that `face_corners` knows, in messages."""
    number = len(CELL_TYPES[cell].faces) if cell in CELL_TYPES else 0
    first = first_edge(element_type)
    return f"S{first} … S{first + number - 1}"
