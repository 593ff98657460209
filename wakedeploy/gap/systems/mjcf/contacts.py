"""Which bodies of a MuJoCo model touch each other where logs have been.

In: a file's elements and measured positions of its joints. Out: sentences for `gap check`.
"""

from collections import Counter
from collections.abc import Mapping

import numpy as np

from wakedeploy.gap.systems.mjcf.elements import Elements, mujoco
from wakedeploy.gap.systems.system import FloatArray
from wakedeploy.gap.wording import listed

_PLACES = 1000  # of the logs' samples that are looked at, evenly
_MOST_TOLD = 3  # pairs of bodies


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
    often = Counter(pair for found in pairs for pair in found)
    named = listed([" and ".join(pair) for pair, _ in often.most_common(_MOST_TOLD)])
    return [
        f"bodies of {elements.path.name} touch at {touched / len(places):.0%} of the samples "
        f"({named}): a contact acts as the file has it, and nothing that it lacks is searched for. "
        "Leave such logs out; or, where they did not touch, mend the geoms, or take them out of "
        'contacts by contype="0" conaffinity="0".'
    ]


def _may_touch(elements: Elements) -> bool:
    model = elements.model
    return bool(np.any(model.geom_contype) and np.any(model.geom_conaffinity))


def _touching(elements: Elements, places: FloatArray) -> list[set[tuple[str, ...]]]:
    """The pairs of bodies that lie within each other, at each of the places (N, joints)."""
    library, model = mujoco(elements.path), elements.model
    data, found = library.MjData(model), []
    for place in places:
        data.qpos[[j.qpos for j in elements.joints]] = place
        library.mj_fwdPosition(model, data)
        geoms = [(int(c.geom1), int(c.geom2)) for c in data.contact if c.dist < 0.0]
        found.append({tuple(_body(model, geom) for geom in pair) for pair in geoms})
    return found


def _body(model: object, geom: int) -> str:
    body = model.body(int(model.geom_bodyid[geom]))  # type: ignore[attr-defined]
    return str(body.name) or f"body {body.id}"
