"""Without a force no stress is measured: stresses are shown as ratios to a locked one, never in MPa."""

from __future__ import annotations

from collections.abc import Mapping

STRESS_FACTORS = {"Pa": 1e-6, "kPa": 1e-3, "MPa": 1.0, "N/mm2": 1.0, "GPa": 1e3}  # MPa
SCALED = ("value", "std", "start", "systematic_std", "discretisation_bias", "std_noise", "std_model")


def in_ratios(result: Mapping) -> Mapping:
    """The result as it is shown: without a force, determined stresses over the first held one of their element set.

    ``sheet.yield_stress`` becomes ``sheet.yield_stress/E``, without a unit; everything else stays.
    """
    base_of_set = _held(result)
    if not base_of_set:
        return result
    renamed: dict[str, str] = {}
    changed, bounds = dict(result), dict(result.get("at_bound", {}))
    for kind in ("parameters", "derived"):
        entries = {}
        for name, entry in result.get(kind, {}).items():
            base = _base(name, entry, base_of_set)
            if base is not None:
                renamed[name] = f"{name}/{_short(base, name)}"
                if name in bounds:
                    bounds[renamed[name]] = bounds.pop(name) * _ratio(entry, result["parameters"][base])
                entry = _scaled(entry, result["parameters"][base])
            entries[renamed.get(name, name)] = entry
        changed[kind] = entries
    if bounds:
        changed["at_bound"] = bounds
    if specimens := result.get("specimens"):
        changed["specimens"] = {renamed.get(name, name): _specimen(entry, _factor(result, name, base_of_set))
                                for name, entry in specimens.items()}
    if table := result.get("correlation"):
        changed["correlation"] = dict(table) | {"names": [renamed.get(name, name) for name in table.get("names", ())]}
    return changed


def _factor(result: Mapping, name: str, base_of_set: Mapping[str, str]) -> float | None:
    """What a parameter is multiplied by to be shown as a ratio, None for one that is not."""
    entry = result["parameters"][name]
    base = _base(name, entry, base_of_set)
    return None if base is None else _ratio(entry, result["parameters"][base])


def _specimen(entry: Mapping, factor: float | None) -> Mapping:
    """The values of each specimen and their scatter, as a ratio."""
    if factor is None:
        return entry
    sizes = {key: None if entry[key] is None else factor * entry[key] for key in ("between_std", "mean", "mean_std")}
    interval = entry["between_ci95"] and [factor * bound for bound in entry["between_ci95"]]
    values = {name: {key: factor * size for key, size in estimate.items()}
              for name, estimate in entry["values"].items()}
    return {**entry, **sizes, "between_ci95": interval, "unit": "", "values": values}


def stress_unit(result: Mapping, element_set: str) -> tuple[str, float]:
    """Unit of the stresses of an element set as they are shown, and its size in MPa: MPa itself, or a held stress."""
    base_of_set = _held(result)
    base = base_of_set.get(element_set, base_of_set.get(""))
    if base is None:
        return "MPa", 1.0
    entry = result["parameters"][base]
    return base.rpartition(".")[2], entry["value"] * STRESS_FACTORS[entry["unit"]]


def held_stresses(result: Mapping) -> str:
    """The held stresses that shown ratios rest on, in a sentence; empty where a force was recorded, or none does."""
    base_of_set = _held(result)
    bases = dict.fromkeys(base for kind in ("parameters", "derived") for name, entry in result.get(kind, {}).items()
                          if (base := _base(name, entry, base_of_set)) is not None)
    if not bases:
        return ""
    listed = ", ".join(f"{name.rpartition('.')[2]} = {result['parameters'][name]['value']:g} "
                       f"{result['parameters'][name]['unit']}" for name in bases)
    return f"No force was recorded. Stresses are ratios to {listed}, given and not measured."


def _held(result: Mapping) -> dict[str, str]:
    """Element set -> its first locked stress that is not zero, "" -> the first of all; empty where a force is known."""
    names_by_set: dict[str, str] = {}
    if result.get("has_force", True):
        return names_by_set
    for name, entry in result["parameters"].items():
        if not entry.get("free") and entry.get("unit") in STRESS_FACTORS and entry.get("value"):
            names_by_set.setdefault(name.rpartition(".")[0], name)
            names_by_set.setdefault("", name)
    return names_by_set


def _base(name: str, entry: Mapping, base_of_set: Mapping[str, str]) -> str | None:
    """The held stress that a determined stress is shown over, None for everything else."""
    if not entry.get("free", True) or entry.get("std") is None or entry.get("unit") not in STRESS_FACTORS:
        return None
    return base_of_set.get(name.rpartition(".")[0], base_of_set.get(""))


def _short(base: str, name: str) -> str:
    """`base` without its element set where that is the same."""
    return base.rpartition(".")[2] if base.rpartition(".")[0] == name.rpartition(".")[0] else base


def _ratio(entry: Mapping, base: Mapping) -> float:
    """Shown ratio per unit of a stress."""
    return STRESS_FACTORS[entry["unit"]] / (STRESS_FACTORS[base["unit"]] * base["value"])


def _scaled(entry: Mapping, base: Mapping) -> dict:
    factor = _ratio(entry, base)
    changed = {key: entry[key] * factor for key in SCALED if entry.get(key) is not None}
    interval = {"ci95": [bound * factor for bound in entry["ci95"]]} if entry.get("ci95") else {}
    return dict(entry) | changed | interval | {"unit": ""}
