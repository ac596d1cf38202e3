"""What the bounce loop is computed with: Dr.Jit (compiled for all cores, or a GPU) or NumPy.

The loop and the geometry are written once, on scalars and tuples (x, y, z) of arrays with one entry
a lane; a machine gives the few functions that Python's operators do not have. NumPy is the slower
one, and needs no LLVM.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from domesim.host.cores import cores
from domesim.room.theatre import Solid

Lanes: TypeAlias = Any
"""One number for each lane: an array of the machine."""

Vector: TypeAlias = tuple[Lanes, Lanes, Lanes]
"""(x, y, z), each of them lanes."""

State = TypeVar("State")

_OFFSET = 1e-5
"""Rays leave a mesh this far above it, in units of the dome's radius."""


class Machine(ABC):
    """Arithmetic on lanes."""

    name: str
    launch: int
    """Walks that are computed before anyone may interrupt: a second or few."""
    width: int
    """Lanes that keep it busy."""

    @abstractmethod
    def lanes(self, values: NDArray[Any]) -> Lanes:
        """An array (float, or int for indices) as lanes."""

    @abstractmethod
    def array(self, values: Lanes) -> NDArray[np.float64]:
        """Lanes as an array: waits until they are computed."""

    @abstractmethod
    def full(self, value: float, count: int) -> Lanes:
        """`count` lanes of the same number."""

    @abstractmethod
    def whole(self, value: int, count: int) -> Lanes:
        """`count` lanes of the same whole number."""

    @abstractmethod
    def parameter(self, value: float) -> Lanes:
        """A number, the same for all lanes, that may change without compiling anew.

        Integers are whole numbers; others have double precision.
        """

    @abstractmethod
    def where(self, condition: Lanes, yes: Any, no: Any) -> Lanes:
        """`yes` in the lanes where `condition` holds, `no` in the others."""

    @abstractmethod
    def sqrt(self, value: Lanes) -> Lanes:
        """Square root."""

    @abstractmethod
    def cos(self, value: Lanes) -> Lanes:
        """Cosine."""

    @abstractmethod
    def sin(self, value: Lanes) -> Lanes:
        """Sine."""

    @abstractmethod
    def acos(self, value: Lanes) -> Lanes:
        """Arc cosine."""

    @abstractmethod
    def minimum(self, left: Lanes, right: Any) -> Lanes:
        """The smaller."""

    @abstractmethod
    def maximum(self, left: Lanes, right: Any) -> Lanes:
        """The larger."""

    @abstractmethod
    def index(self, value: Lanes) -> Lanes:
        """Whole number below a value that is not negative."""

    @abstractmethod
    def number(self, index: Lanes) -> Lanes:
        """A whole number as any other."""

    @abstractmethod
    def gather(self, table: Lanes, index: Lanes, active: Lanes) -> Lanes:
        """table[index] in the active lanes, 0 in the others."""

    @abstractmethod
    def number_at(self, table: Lanes, index: Lanes) -> Lanes:
        """The whole number table[index]."""

    @abstractmethod
    def colours(self, values: NDArray[Any]) -> Any:
        """A table of (entry, 4) for `colour_at`."""

    @abstractmethod
    def colour_at(self, table: Any, index: Lanes, active: Lanes) -> tuple[Vector, Lanes]:
        """The three and one numbers of table[index] in the active lanes, 0 in the others."""

    @abstractmethod
    def add_at(self, table: Lanes, index: Lanes, value: Lanes, active: Lanes) -> None:
        """table[index] += value in the active lanes, in place; each has an index of its own."""

    @abstractmethod
    def pooled(self, values: Lanes, count: int) -> Lanes:
        """Sums of each `count` lanes in a row, in double precision."""

    @abstractmethod
    def single(self, values: Lanes) -> Lanes:
        """Lanes of double precision as any others."""

    @abstractmethod
    def sum(self, values: Lanes) -> float:
        """Sum of all lanes, in double precision."""

    @abstractmethod
    def computed(self, state: State) -> State:
        """The same lanes, computed: waits for it."""

    @abstractmethod
    def release(self) -> None:
        """Give memory back that no lanes need any more."""

    @abstractmethod
    def randomness(self, seed: int, count: int) -> Any:
        """A source of random numbers for `count` lanes."""

    @abstractmethod
    def uniform(self, randomness: Any) -> Lanes:
        """The next number in [0, 1) of each lane."""

    @abstractmethod
    def loop(
        self, state: State, goes_on: Callable[[State], Lanes], step: Callable[[State], State]
    ) -> State:
        """Repeat `step` on the lanes of `state` in which `goes_on` holds, until there are none.

        Random numbers and tables that `step` changes in place are its own care.
        """

    @abstractmethod
    def mesh(self, solids: Sequence[Solid], radius: float) -> Mesh:
        """The solids, in units of `radius`, to intersect rays with."""


class Mesh(ABC):
    """Triangles that rays can hit."""

    @abstractmethod
    def hit(self, origin: Vector, direction: Vector, active: Lanes) -> tuple[Lanes, Vector, Lanes]:
        """Distance (infinite without a hit), unit normal towards the ray, index of the solid."""


@final
class DrJit(Machine):
    """Dr.Jit arrays of Mitsuba's variant, LLVM or CUDA.

    Parameters
    ----------
    mitsuba
        The module, with a vectorised variant set.
    """

    name = "Dr.Jit"
    # The same on all devices: a lane has its own random numbers
    width = 1 << 16

    def __init__(self, mitsuba: Any) -> None:
        import drjit  # noqa: PLC0415

        self.mi, self.dr = mitsuba, drjit
        on_gpu = mitsuba.variant().startswith("cuda")
        self.launch = 1 << 26 if on_gpu else cores() << 21
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
        """A number, the same for all lanes, that may change without compiling anew."""
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
        """The smaller."""
        return self.dr.minimum(left, right)

    def maximum(self, left: Lanes, right: Any) -> Lanes:
        """The larger."""
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
        found = self.dr.gather(self.mi.Vector4f, table, index, active)
        return (found.x, found.y, found.z), found.w

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
        """The same lanes, computed: waits for it."""
        self.dr.make_opaque(state)
        self.dr.sync_thread()
        return state

    def release(self) -> None:
        """Give memory back that no lanes need any more."""
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
        """Repeat `step` on `state` while `goes_on` holds in any lane: one compiled kernel."""
        (result,) = self.dr.while_loop((state,), goes_on, lambda value: (step(value),))
        return result

    def mesh(self, solids: Sequence[Solid], radius: float) -> Mesh:
        """The solids, in units of `radius`, to intersect rays with."""
        return _MitsubaMesh(self, solids, radius)


@final
class NumPy(Machine):
    """NumPy arrays in float64: readable, portable, a hundred times slower."""

    name = "NumPy"
    launch = 1 << 16
    width = 1 << 12

    def lanes(self, values: NDArray[Any]) -> Lanes:
        """An array (float, or int for indices) as lanes."""
        if np.issubdtype(values.dtype, np.integer):
            return np.asarray(values, np.int64)
        return np.asarray(values, np.float64)

    def array(self, values: Lanes) -> NDArray[np.float64]:
        """Lanes as an array."""
        return np.asarray(values, np.float64)

    def full(self, value: float, count: int) -> Lanes:
        """`count` lanes of the same number."""
        return np.full(count, value, np.float64)

    def whole(self, value: int, count: int) -> Lanes:
        """`count` lanes of the same whole number."""
        return np.full(count, value, np.int64)

    def parameter(self, value: float) -> Lanes:
        """A number, the same for all lanes."""
        return value

    def where(self, condition: Lanes, yes: Any, no: Any) -> Lanes:
        """`yes` in the lanes where `condition` holds, `no` in the others."""
        return np.where(condition, yes, no)

    def sqrt(self, value: Lanes) -> Lanes:
        """Square root; NaN of what is negative."""
        with np.errstate(invalid="ignore"):
            return np.sqrt(value)

    def cos(self, value: Lanes) -> Lanes:
        """Cosine."""
        return np.cos(value)

    def sin(self, value: Lanes) -> Lanes:
        """Sine."""
        return np.sin(value)

    def acos(self, value: Lanes) -> Lanes:
        """Arc cosine."""
        return np.arccos(value)

    def minimum(self, left: Lanes, right: Any) -> Lanes:
        """The smaller."""
        return np.minimum(left, right)

    def maximum(self, left: Lanes, right: Any) -> Lanes:
        """The larger."""
        return np.maximum(left, right)

    def index(self, value: Lanes) -> Lanes:
        """Whole number below a value that is not negative."""
        return np.asarray(value).astype(np.int64)

    def number(self, index: Lanes) -> Lanes:
        """A whole number as any other."""
        return index.astype(np.float64)

    def gather(self, table: Lanes, index: Lanes, active: Lanes) -> Lanes:
        """table[index] in the active lanes, 0 in the others."""
        return np.where(active, table[np.where(active, index, 0)], 0.0)

    def number_at(self, table: Lanes, index: Lanes) -> Lanes:
        """The whole number table[index]."""
        return table[index]

    def colours(self, values: NDArray[Any]) -> Any:
        """A table of (entry, 4) for `colour_at`."""
        return np.asarray(values, np.float64)

    def colour_at(self, table: Any, index: Lanes, active: Lanes) -> tuple[Vector, Lanes]:
        """The three and one numbers of table[index] in the active lanes, 0 in the others."""
        x, y, z, w = np.where(active[:, None], table[np.where(active, index, 0)], 0.0).T
        return (x, y, z), w

    def add_at(self, table: Lanes, index: Lanes, value: Lanes, active: Lanes) -> None:
        """table[index] += value in the active lanes, in place; each has an index of its own."""
        table[index[active]] += value[active]

    def pooled(self, values: Lanes, count: int) -> Lanes:
        """Sums of each `count` lanes in a row."""
        return values.reshape(-1, count).sum(axis=1)

    def single(self, values: Lanes) -> Lanes:
        """Lanes as they are."""
        return values

    def sum(self, values: Lanes) -> float:
        """Sum of all lanes."""
        return float(values.sum())

    def computed(self, state: State) -> State:
        """The same lanes: nothing is waited for here."""
        return state

    def release(self) -> None:
        """Nothing is kept."""

    def randomness(self, seed: int, count: int) -> Any:
        """A source of random numbers for `count` lanes."""
        return np.random.default_rng(seed), count

    def uniform(self, randomness: Any) -> Lanes:
        """The next number in [0, 1) of each lane."""
        generator, count = randomness
        return generator.random(count)

    def loop(
        self, state: State, goes_on: Callable[[State], Lanes], step: Callable[[State], State]
    ) -> State:
        """Repeat `step` on the lanes of `state` in which `goes_on` holds, until there are none."""
        # Lanes that have left for good divide by zero on their way.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            while np.any(going := goes_on(state)):
                state = _where(going, step(state), state)
        return state

    def mesh(self, solids: Sequence[Solid], radius: float) -> Mesh:
        """The solids, in units of `radius`, to intersect rays with."""
        return _TrimeshMesh(solids, radius)


def _where(going: NDArray[np.bool_], new: Any, old: Any) -> Any:
    """`new` in some lanes and `old` in the others, of all arrays in dicts, lists and tuples."""
    if isinstance(new, dict):
        return {name: _where(going, value, old[name]) for name, value in new.items()}
    if isinstance(new, list | tuple):
        return type(new)(_where(going, *pair) for pair in zip(new, old, strict=True))
    return np.where(going, new, old) if isinstance(new, np.ndarray) else new


@final
class _MitsubaMesh(Mesh):
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
        found = self._scene.ray_intersect_preliminary(ray, coherent=False, active=active)
        si = found.compute_surface_interaction(ray, mi.RayFlags.Minimal, active)
        valid = found.is_valid() & active
        n = dr.select(dr.dot(si.n, ray.d) > 0, -si.n, si.n)
        number = mi.UInt32(0)
        for pointer, index in zip(self._pointers, self._numbers, strict=True):
            number = dr.select(si.shape == pointer, mi.UInt32(index), number)
        return dr.select(valid, found.t, dr.inf), (n.x, n.y, n.z), number


@final
class _TrimeshMesh(Mesh):
    def __init__(self, solids: Sequence[Solid], radius: float) -> None:
        import trimesh  # noqa: PLC0415
        from trimesh.ray.ray_pyembree import RayMeshIntersector  # noqa: PLC0415

        parts = [trimesh.Trimesh(s.vertices / radius, s.faces, process=False) for s in solids]
        whole: Any = trimesh.util.concatenate(parts)
        self._normals = np.asarray(whole.face_normals)
        self._first = np.cumsum([0, *(len(solid.faces) for solid in solids)])
        self._corner = np.asarray(whole.triangles)[:, 0]
        self._rays = RayMeshIntersector(whole)

    def hit(self, origin: Vector, direction: Vector, active: Lanes) -> tuple[Lanes, Vector, Lanes]:
        """Distance (infinite without a hit), unit normal towards the ray, index of the solid."""
        o, d = np.stack(origin, -1), np.stack(direction, -1)
        ready = active & np.all(np.isfinite(o) & np.isfinite(d), axis=-1)
        face = np.full(len(o), -1)
        if ready.any():
            face[ready] = self._rays.intersects_first(o[ready], d[ready])
        n = self._normals[face]
        slope = np.sum(n * d, -1)
        distance = np.sum(n * (self._corner[face] - o), -1) / slope
        n = np.where((slope > 0)[:, None], -n, n)
        number = np.searchsorted(self._first, face, "right") - 1
        distance = np.where((face >= 0) & (distance > 0), distance, np.inf)
        return distance, (n[:, 0], n[:, 1], n[:, 2]), np.maximum(number, 0)
