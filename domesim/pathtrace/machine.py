"""Dr.Jit's arrays, in which the bounce loop is computed on all cores or a GPU.

Loop and geometry are written on tuples (x, y, z) of arrays with one entry a lane. Besides Python's
operators they use `DrJit`'s functions, some of which have NumPy's names: `domesim.room.rays` takes
either.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from domesim.host.cores import cores
from domesim.room.rays import Lanes, Room, Vector
from domesim.room.theatre import Solid, Theatre

State = TypeVar("State")


@final
class DrJit:
    """Dr.Jit arrays of Mitsuba's variant, LLVM or CUDA.

    Parameters
    ----------
    mitsuba
        The module, with a variant set of `domesim.pathtrace.llvm.load_mitsuba`.
    """

    name = "Dr.Jit"
    # The same on all devices: a lane has its own random numbers
    width = 1 << 16
    """Lanes that keep it busy."""

    def __init__(self, mitsuba: Any) -> None:
        import drjit  # noqa: PLC0415

        self.mi, self.dr = mitsuba, drjit
        on_gpu = mitsuba.variant().startswith("cuda")
        self.launch = 1 << 26 if on_gpu else cores() << 21
        """Walks that are computed before anyone may interrupt: a second or few."""
        self._double: Any = drjit.float64_array_t(mitsuba.Float)

    def lanes(self, values: NDArray[Any]) -> Lanes:
        """An array (float, or int for indices) as lanes."""
        if np.issubdtype(values.dtype, np.integer):
            return self.mi.UInt32(np.ascontiguousarray(values, np.uint32))
        return self.mi.Float(np.ascontiguousarray(values, np.float32))

    def array(self, values: Lanes) -> NDArray[np.float64]:
        """Lanes as an array: waits until they are computed."""
        return np.asarray(values.numpy(), np.float64)

    def full(self, value: float, count: int) -> Lanes:
        """`count` lanes of the same number."""
        return self.dr.full(self.mi.Float, value, count)

    def whole(self, value: int, count: int) -> Lanes:
        """`count` lanes of the same whole number."""
        return self.dr.full(self.mi.UInt32, value, count)

    def parameter(self, value: float) -> Lanes:
        """A number, the same for all lanes, that may change without compiling anew.

        Integers are whole numbers; others have double precision.
        """
        return self.dr.opaque(self.mi.UInt32 if isinstance(value, int) else self._double, value)

    def where(self, condition: Lanes, yes: Any, no: Any) -> Lanes:
        """`yes` in the lanes where `condition` holds, `no` in the others."""
        if isinstance(yes, int) and isinstance(no, int):
            yes = self.mi.UInt32(yes)
        return self.dr.select(condition, yes, no)

    def sqrt(self, value: Lanes) -> Lanes:
        """Square root."""
        return self.dr.sqrt(value)

    def cos(self, value: Lanes) -> Lanes:
        """Cosine."""
        return self.dr.cos(value)

    def sin(self, value: Lanes) -> Lanes:
        """Sine."""
        return self.dr.sin(value)

    def acos(self, value: Lanes) -> Lanes:
        """Arc cosine."""
        return self.dr.acos(value)

    def minimum(self, left: Lanes, right: Any) -> Lanes:
        """The smaller of two numbers."""
        return self.dr.minimum(left, right)

    def maximum(self, left: Lanes, right: Any) -> Lanes:
        """The larger of two numbers."""
        return self.dr.maximum(left, right)

    def index(self, value: Lanes) -> Lanes:
        """Whole number below a value that is not negative."""
        return self.mi.UInt32(value)

    def number(self, index: Lanes) -> Lanes:
        """A whole number as any other."""
        return self.mi.Float(index)

    def gather(self, table: Lanes, index: Lanes, active: Lanes) -> Lanes:
        """table[index] in the active lanes, 0 in the others."""
        return self.dr.gather(self.mi.Float, table, index, active)

    def number_at(self, table: Lanes, index: Lanes) -> Lanes:
        """The whole number table[index]."""
        return self.dr.gather(self.mi.UInt32, table, index)

    def colours(self, values: NDArray[Any]) -> Any:
        """A table of (entry, 4) for `colour_at`."""
        return self.mi.Float(np.ascontiguousarray(values, np.float32).ravel())

    def colour_at(self, table: Any, index: Lanes, active: Lanes) -> tuple[Vector, Lanes]:
        """The three and one numbers of table[index] in the active lanes, 0 in the others."""
        texel = self.dr.gather(self.mi.Vector4f, table, index, active)
        return (texel.x, texel.y, texel.z), texel.w

    def add_at(self, table: Lanes, index: Lanes, value: Lanes, active: Lanes) -> None:
        """table[index] += value in the active lanes, in place; each has an index of its own."""
        mode = self.dr.ReduceMode.NoConflicts
        self.dr.scatter_reduce(self.dr.ReduceOp.Add, table, value, index, active, mode)

    def pooled(self, values: Lanes, count: int) -> Lanes:
        """Sums of each `count` lanes in a row, in double precision."""
        return self.dr.block_sum(self._double(values), count)

    def single(self, values: Lanes) -> Lanes:
        """Lanes of double precision as any others."""
        return self.mi.Float(values)

    def sum(self, values: Lanes) -> float:
        """Sum of all lanes, in double precision."""
        return float(self.dr.sum(self._double(values))[0])

    def computed(self, state: State) -> State:
        """Computes the lanes, and waits for them."""
        self.dr.make_opaque(state)
        self.dr.sync_thread()
        return state

    def release(self) -> None:
        """Frees memory that no lanes need any more."""
        self.dr.flush_malloc_cache()

    def randomness(self, seed: int, count: int) -> Any:
        """A source of random numbers for `count` lanes."""
        return self.mi.PCG32(size=count, initstate=self.dr.opaque(self.mi.UInt64, seed))

    def uniform(self, randomness: Any) -> Lanes:
        """The next number in [0, 1) of each lane."""
        return randomness.next_float32()

    def loop(
        self, state: State, goes_on: Callable[[State], Lanes], step: Callable[[State], State]
    ) -> State:
        """Repeat `step` on the lanes of `state` in which `goes_on` holds: one compiled kernel.

        Random numbers and tables that `step` changes in place are its own care.
        """
        (result,) = self.dr.while_loop((state,), goes_on, lambda value: (step(value),))
        return result

    def room(self, theatre: Theatre) -> Room:
        """A theatre as rays meet it, solids and all."""
        solids = theatre.solids
        mesh = _Solids(self, solids, theatre.dome.radius) if solids else None
        room = Room(theatre, self, mesh)
        if theatre.paint is not None:
            room.painted = self.paint(theatre.paint.factors)
        return room

    def paint(self, factors: NDArray[Any]) -> Any:
        """A table for `colour_at` of (row, col, primary) factors, of which one stands for all."""
        wide = np.broadcast_to(factors, (*factors.shape[:2], 3)).reshape(-1, 3)
        return self.colours(np.pad(wide, ((0, 0), (0, 1))))


@final
class _Solids:
    """Solids, in units of `radius`, as Mitsuba meets them."""

    def __init__(self, machine: DrJit, solids: Sequence[Solid], radius: float) -> None:
        mi = machine.mi
        self._machine = machine
        parts: dict[str, Any] = {"type": "scene"}
        for number, solid in enumerate(solids):
            shape = mi.Mesh(solid.name, len(solid.vertices), len(solid.faces))
            parameters = mi.traverse(shape)
            parameters["vertex_positions"] = mi.Float((solid.vertices / radius).ravel())
            parameters["faces"] = mi.UInt32(solid.faces.ravel())
            parameters.update()
            parts[f"solid{number}"] = shape
        self._scene = mi.load_dict(parts)
        # A shape is told by its pointer; the scene may order them as it likes.
        self._pointers = [mi.ShapePtr(shape) for shape in self._scene.shapes()]
        names = [shape.id() for shape in self._scene.shapes()]
        self._numbers = [int(name.removeprefix("solid")) for name in names]

    def hit(self, origin: Vector, direction: Vector, active: Lanes) -> tuple[Lanes, Vector, Lanes]:
        """Distance (infinite without a hit), unit normal towards the ray, index of the solid."""
        mi, dr = self._machine.mi, self._machine.dr
        ray = mi.Ray3f(mi.Point3f(*origin), mi.Vector3f(*direction))
        meeting = self._scene.ray_intersect_preliminary(ray, coherent=False, active=active)
        si = meeting.compute_surface_interaction(ray, mi.RayFlags.Minimal, active)
        valid = meeting.is_valid() & active
        n = dr.select(dr.dot(si.n, ray.d) > 0, -si.n, si.n)
        number = mi.UInt32(0)
        for pointer, index in zip(self._pointers, self._numbers, strict=True):
            number = dr.select(si.shape == pointer, mi.UInt32(index), number)
        return dr.select(valid, meeting.t, dr.inf), (n.x, n.y, n.z), number
