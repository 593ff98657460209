"""Which bodies of a MuJoCo model touch each other where logs have been.

In: a file's elements and measured positions of its joints. Out: sentences.
"""

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from wakedeploy.gap.systems.mjcf.elements import Elements
from wakedeploy.gap.systems.mjcf.reading import loaded_mujoco, silent
from wakedeploy.gap.systems.system import FloatArray
from wakedeploy.gap.wording import listed

_PLACES = 1000  # of the logs' samples that are looked at, evenly
_MOST_TOLD = 3  # pairs of bodies
_LEAST_TOLD = 0.01  # share of the samples, which is printed in whole percent


def contact_notes(elements: Elements, outputs: Mapping[str, FloatArray]) -> list[str]:
    """What to know of contacts at the positions (N,) that were measured, by their states' names.

    Joints that no output shows stay where the file has them, so nothing is said unless all are
    measured.
    """
    positions = [j.position for j in elements.joints]
    if not set(positions) <= set(outputs) or not _may_touch(elements):
        return []
    places = np.array([outputs[name] for name in positions]).T
    places = places[np.isfinite(places).all(1)]
    if not len(places):
        return []
    places = places[np.unique(np.linspace(0, len(places) - 1, _PLACES).astype(int))]
    pairs = _touching(elements, places)
    touched = sum(1 for found in pairs if found)
    if not touched:
        return []
    often = Counter(pair for found in pairs for pair in found).most_common(_MOST_TOLD)
    names = [[elements.model.body(at).name or f"body {at}" for at in pair] for pair, _ in often]
    named = listed([" and ".join(pair) for pair in names])
    share = touched / len(places)
    shown = f"{share:.0%}" if share >= _LEAST_TOLD else f"less than {_LEAST_TOLD:.0%}"
    return [
        f"bodies of {elements.path.name} touch at {shown} of the samples "
        f"({named}): a contact acts as the file has it, and nothing that it lacks is searched for. "
        "Leave such logs out; or, where they did not touch, mend the geoms, or take them out of "
        'contacts by contype="0" conaffinity="0", and out of any <contact><pair>.'
    ]


def _may_touch(elements: Elements) -> bool:
    model = elements.model
    by_kind = np.any(model.geom_contype) and np.any(model.geom_conaffinity)
    return bool(by_kind or model.npair)


def _touching(elements: Elements, places: FloatArray) -> list[set[tuple[int, ...]]]:
    """The pairs of bodies that push each other, at each of the places (N, joints)."""
    library, model = loaded_mujoco(elements.path), elements.model
    data, found = library.MjData(model), []
    with silent(library):
        for place in elements.positions(places):
            data.qpos[:] = place
            library.mj_fwdPosition(model, data)
            found.append({_bodies(model, c) for c in data.contact if _pushes(c)})
    return found


def _pushes(contact: Any) -> bool:
    """Whether two geoms, and not something soft, are near enough for a force."""
    is_of_geoms = contact.geom1 >= 0 and contact.geom2 >= 0
    return bool(is_of_geoms and not contact.exclude and contact.dist < contact.includemargin)


def _bodies(model: Any, contact: Any) -> tuple[int, ...]:
    return tuple(sorted(int(model.geom_bodyid[geom]) for geom in (contact.geom1, contact.geom2)))
