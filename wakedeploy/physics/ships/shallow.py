"""Ships in shallow water as lines of vortices that shed wakes, level B: the past is in the wakes.

In: where two hulls are, step by step. Out: sway force and yaw moment on both. Seen from far the
water is a plane: a hull displaces (sources σ = −U S′/h) and blocks it, so that a flow V across
leaves a jump 2 C V of the potential; where the jump changes along the hull there are vortices. The
jump at the stern stays behind in the water (Kutta), and with it all circulation that the hull has
lost (Kelvin): a wake that lies where it was shed and pushes whoever comes by later. Yeung, 12th
Symp. Naval Hydrodynamics (1978); Kijima and Yasukawa, J. Soc. Nav. Arch. Japan 158 (1985).

The jump is constant on each panel, in hull and wake alike, so a panel is a pair of opposite
vortices at its ends. Hulls lie along the channel: headings are small.
"""

from dataclasses import dataclass, field

import numpy as np

from wakedeploy.physics.ships.hull import WATER_KGPM3, FloatArray, Hull, mirrors

SHIPS = 2


@dataclass(frozen=True)
class Waterway:
    """Two hulls and the channel: its depth, walls at ±`wall_m` or none.

    `panels` are per hull; wakes are kept for `wake_lengths` hulls; `images` are those of each ship
    in the walls, on either side.
    """

    hulls: tuple[Hull, Hull] = field(default_factory=lambda: (Hull(), Hull()))
    depth_m: float = 7.5
    wall_m: float | None = None
    panels: int = 40
    wake_lengths: float = 3.0
    images: int = 4


@dataclass(frozen=True, eq=False)
class Loads:
    """On both ships: force across [N], to port of a ship that heads along x, and moment [N·m].

    A positive moment turns x towards y.
    """

    sway_n: FloatArray
    yaw_nm: FloatArray


class VortexShips:
    """Two ships on their way, with the wakes they have left so far."""

    def __init__(self, waterway: Waterway) -> None:
        self.waterway = waterway
        self._along: list[FloatArray] = []  # panel ends from the stern [m], 0 amidships
        self._middle: list[FloatArray] = []
        self._inverse_blockage: list[FloatArray] = []
        for hull in waterway.hulls:
            ends = hull.length_m * np.linspace(-0.5, 0.5, waterway.panels + 1)
            middle = 0.5 * (ends[1:] + ends[:-1])
            self._along.append(ends)
            self._middle.append(middle)
            blockage = hull.blockage_m(middle, waterway.depth_m)
            self._inverse_blockage.append(0.5 / blockage)
        # Wakes: (w, 4) of older end, newer end [m], aside [m], jump [m²/s]
        self._wake = [np.zeros((0, 4)) for _ in range(SHIPS)]
        self._mirrors = mirrors(waterway.wall_m, waterway.images)
        self._stern: list[tuple[float, float] | None] = [None] * SHIPS
        self._jump: FloatArray | None = None

    def step(
        self, x_m: FloatArray, aside_m: FloatArray, speed_mps: FloatArray, dt_s: float
    ) -> Loads:
        """Advance to where the ships are now, (2,) each; their speeds are signed along x.

        The first step is an impulsive start with wakes of no length; its rate of change is left
        out of the loads.
        """
        heading = np.where(np.asarray(speed_mps) < 0.0, -1.0, 1.0)
        stern = [
            (float(x_m[i] + heading[i] * self._along[i][0]), float(aside_m[i]))
            for i in range(SHIPS)
        ]
        jump = self._solved(x_m, aside_m, speed_mps, heading, stern)
        loads = self._loads(jump, np.abs(speed_mps), heading, dt_s)
        for i in range(SHIPS):
            self._shed(i, stern[i], jump[i, 0])
        self._jump = jump
        return loads

    def _solved(
        self,
        x_m: FloatArray,
        aside_m: FloatArray,
        speed_mps: FloatArray,
        heading: FloatArray,
        stern: list[tuple[float, float]],
    ) -> FloatArray:
        """The jumps (2, panels): each is 2 C times the flow across that all others make."""
        n = self.waterway.panels
        matrix = np.zeros((SHIPS * n, SHIPS * n))
        flow = np.zeros(SHIPS * n)
        for i in range(SHIPS):
            at = x_m[i] + heading[i] * self._middle[i]
            rows = slice(i * n, (i + 1) * n)
            for j in range(SHIPS):
                columns = slice(j * n, (j + 1) * n)
                ends = x_m[j] + heading[j] * self._along[j]
                for sign, shift in self._mirrors:
                    apart = aside_m[i] - sign * aside_m[j] - shift
                    matrix[rows, columns] += sign * _across(at, ends, apart)
                    if i != j or shift != 0.0:
                        strength = -abs(speed_mps[j]) / self.waterway.depth_m
                        slope = self.waterway.hulls[j].area_slope_m(self._middle[j])
                        flow[rows] += _displaced(at, ends, apart) @ (strength * slope)
                matrix[rows, j * n] += self._new_panel(at, aside_m[i], j, stern[j])
                flow[rows] += self._from_wake(at, aside_m[i], j)
        inverse = np.concatenate(self._inverse_blockage)
        solved = np.linalg.solve(np.diag(inverse) - matrix, flow)
        return np.asarray(solved.reshape(SHIPS, n))

    def _new_panel(
        self, at: FloatArray, aside_m: float, ship: int, stern: tuple[float, float]
    ) -> FloatArray:
        """Flow across (p,) by the panel shed since the last step, per unit of jump."""
        before = self._stern[ship]
        if before is None or before[0] == stern[0]:
            return np.zeros(len(at))
        total = np.zeros(len(at))
        ends = np.array([before[0], stern[0]])
        for sign, shift in self._mirrors:
            total += sign * _across(at, ends, aside_m - sign * stern[1] - shift)[:, 0]
        return total

    def _from_wake(self, at: FloatArray, aside_m: float, ship: int) -> FloatArray:
        older, newer, place, jump = self._wake[ship].T
        total = np.zeros(len(at))
        strength = -np.sign(newer - older) * jump / (2.0 * np.pi)
        since, until = at[:, None] - older, at[:, None] - newer
        for sign, shift in self._mirrors:
            square = (aside_m - sign * place - shift) ** 2
            pair = since / (since**2 + square) - until / (until**2 + square)
            total += pair @ (sign * strength)
        return total

    def _shed(self, ship: int, stern: tuple[float, float], jump: float) -> None:
        before = self._stern[ship]
        self._stern[ship] = stern
        if before is None or before[0] == stern[0]:
            return
        panel = np.array([[before[0], stern[0], stern[1], jump]])
        wake = np.concatenate([self._wake[ship], panel])
        reach = self.waterway.wake_lengths * self.waterway.hulls[ship].length_m
        self._wake[ship] = wake[np.abs(wake[:, 1] - stern[0]) < reach]

    def _loads(
        self, jump: FloatArray, speed_mps: FloatArray, heading: FloatArray, dt_s: float
    ) -> Loads:
        """Y = ρh ∫(∂t − U∂x)ΔΦ dx + ρU ∫S′ V dx along each hull, and its moment."""
        rate = np.zeros_like(jump) if self._jump is None else (jump - self._jump) / dt_s
        depth = self.waterway.depth_m
        sway, yaw = np.zeros(SHIPS), np.zeros(SHIPS)
        for i in range(SHIPS):
            x, ends = self._middle[i], self._along[i]
            width = ends[1] - ends[0]
            flow = self._inverse_blockage[i] * jump[i]
            slope = self.waterway.hulls[i].area_slope_m(x)
            drag = speed_mps[i] * slope * flow
            carried = speed_mps[i] * jump[i, 0]  # −U ∂x over the hull: ahead of the bow no jump
            sway[i] = depth * (rate[i].sum() * width + carried) + drag.sum() * width
            turned = speed_mps[i] * (ends[0] * jump[i, 0] + jump[i].sum() * width)
            yaw[i] = depth * ((x * rate[i]).sum() * width + turned) + (x * drag).sum() * width
        return Loads(WATER_KGPM3 * sway, WATER_KGPM3 * heading * yaw)


def _across(at: FloatArray, ends: FloatArray, apart_m: float) -> FloatArray:
    """Flow across (p, q) at places `at` (p,) by panels between `ends` (q + 1,) of unit jump."""
    distance = at[:, None] - ends[None, :]
    vortex = distance / (distance**2 + apart_m**2)
    direction = 1.0 if ends[-1] > ends[0] else -1.0
    return np.asarray(-direction * (vortex[:, :-1] - vortex[:, 1:]) / (2.0 * np.pi))


def _displaced(at: FloatArray, ends: FloatArray, apart_m: float) -> FloatArray:
    """Flow across (p, q) by panels of sources of unit strength per length."""
    angle = np.sign(apart_m) * np.arctan2(ends[None, :] - at[:, None], abs(apart_m))
    direction = 1.0 if ends[-1] > ends[0] else -1.0
    return np.asarray(direction * (angle[:, 1:] - angle[:, :-1]) / (2.0 * np.pi))
