"""The two kernels, solve and vjp, and the device functions that they are made of, in Warp.

The method is ``newton.hpp`` without its check of slopes: pure pushes, or the start that was given,
then Newton steps that restore W c = f on the way, at most nine tenths of the way to the boundary,
until the decrement is certified. The mathematics and the names are those of ``lane_group.hpp``.

A thread works on ``PER_THREAD`` contacts and ``LANES`` threads side by side on a problem. On CUDA
there are as many lanes as contacts (2, 4 or 8) and one contact a thread, whose numbers stay in
registers for the whole solve; what the lanes add up goes through shuffles. Warp's CPU device runs
threads one after the other, so there one thread has all contacts and reads them again from memory
in each step. Everything else is the same code.

All sizes are fixed when a kernel is compiled, one module a layout.
"""

# The functions in `kernels` are written in Warp's language and compiled from their source: types
# are values there, a literal is a constant until it is wrapped, `and` does not fold what is static.
# pyright: basic
# pyright: reportInvalidTypeForm=false
# ruff: noqa: RUF046, SIM102, SIM300, UP018

import functools
from dataclasses import dataclass
from typing import Any, Literal

import warp

from graspforce._engine.outcome import Status
from graspforce.equations import RUNAWAY
from graspforce.problem import REMOVAL_THRESHOLD, SQUEEZE

wp: Any = warp  # its types are made at run time, out of a type checker's sight

Precision = Literal["double", "single"]
WRENCH = 6  # rows of W

# Steps within which W c = f has to be restored, as in newton.hpp.
MAX_UNBALANCED_STEPS = 12
# Share of the wrenches that add up to f to which W c = f has to hold.
BALANCED = {"double": 1e-10, "single": 1e-5}
# Share of its diagonal entry below which a pivot counts as lost to rounding.
LOST_PIVOT = {"double": 1e-15, "single": 1e-7}
# What a normal force keeps to where its floor is its ceiling, a share of it.
BAND = {"double": SQUEEZE, "single": 1e-4}
# The smallest number whose reciprocal is taken.
TINY = {"double": "1e-280", "single": "1e-36f"}
THREADS, WARP = 128, 32  # of a block, of a warp
# Blocks that a multiprocessor has room for, the best on an H100: two leave a thread 255 registers.
BLOCKS = {"double": 2, "single": 4}


@dataclass(frozen=True)
class Shape:
    """What a kernel is compiled for.

    Attributes:
        dims: components of each contact.
        joints: of each contact's finger; 0 without J.
        ceilings: c_max is given.
        floors: c_min is given.
        engagement: is given.
        bias: tau_bias is given.
        precision: of numbers and arithmetic.
        lanes: threads a problem.
    """

    dims: tuple[int, ...]
    joints: int
    ceilings: bool
    floors: bool
    engagement: bool
    bias: bool
    precision: Precision
    lanes: int


@dataclass(frozen=True)
class Kernels:
    """The kernels of a shape, and the structures of arrays that they take."""

    solve: Any
    vjp: Any
    Inputs: Any
    Outputs: Any
    real: Any


@functools.cache
def kernels(shape: Shape) -> Kernels:
    """Return the kernels of a shape; Warp compiles them when they are loaded onto a device."""
    real = wp.float64 if shape.precision == "double" else wp.float32
    R = real
    N, LANES = len(shape.dims), shape.lanes
    PER_THREAD = -(-N // LANES)
    Q, K = max(shape.dims), shape.joints
    CEILINGS, FLOORS, ENGAGEMENT, BIAS = shape.ceilings, shape.floors, shape.engagement, shape.bias
    TORSION = 4 in shape.dims
    # Lanes or engagements may leave contacts idle, contacts may have components to spare.
    IDLE = PER_THREAD * LANES > N or ENGAGEMENT
    MIXED = len(set(shape.dims)) > 1
    padded = (*shape.dims, *(0,) * (8 - N))
    DIM = wp.constant(wp.types.vector(8, int)(*padded))
    FIRST = wp.constant(wp.types.vector(8, int)(*(sum(padded[:i]) for i in range(8))))
    LOWER, LOWER6 = Q * (Q + 1) // 2, WRENCH * (WRENCH + 1) // 2
    BALANCE, LOST = BALANCED[shape.precision], LOST_PIVOT[shape.precision]
    ABOVE, BELOW = 1 + BAND[shape.precision], 1 - BAND[shape.precision]
    SOLVED, UNBOUNDED = int(Status.SOLVED), int(Status.UNBOUNDED)
    MAX_STEPS, STALLED = int(Status.MAX_STEPS), int(Status.STALLED)
    INVALID_NUMBERS = int(Status.INVALID_NUMBERS)

    vecQ, vecL, vec6, vec21 = (wp.types.vector(n, real) for n in (Q, LOWER, WRENCH, LOWER6))
    vecK, matW, matJ = wp.types.vector(max(K, 1), real), *(
        wp.types.matrix(n, real) for n in ((WRENCH, Q), (Q, max(K, 1)))
    )  # fmt: skip
    pointsQ, pointsL = (wp.types.matrix((PER_THREAD, n), real) for n in (Q, LOWER))
    A1, A2, A3 = wp.array(dtype=real), wp.array2d(dtype=real), wp.array3d(dtype=real)
    I1 = wp.array(dtype=int)

    @wp.struct
    class Inputs:
        W: A3
        f: A2
        mu: A2
        gamma: A2
        J: A3
        tau_lo: A2
        tau_hi: A2
        tau_bias: A2
        c_max: A2
        c_min: A2
        engagement: A2
        alpha: A1

    @wp.struct
    class Outputs:
        c: A2
        tau: A2
        nu: A2
        status: I1
        newton_steps: I1

    @wp.struct
    class Contact:
        W: matW
        J: matJ
        lo: vecK
        hi: vecK
        mu: real
        torsion: real
        ceiling: real
        floor: real
        there: real  # 1, or 0 for a contact out of the grasp

    # ---- arithmetic ------------------------------------------------------------------------------

    if shape.precision == "double":
        # 20 bits from the processor, then one step of third order: no branch, no call.
        refine = "double e = fma(-x, r, 1.0); e = fma(e, e, e); return fma(r, e, r);"
        refine_root = "double e = fma(-x * r, r, 1.0); return x * fma(fma(.375, e, .5) * e, r, r);"
        number, suffix, register = "double", "f64", "d"
    else:
        refine, refine_root = "return r;", "return x * r;"
        number, suffix, register = "float", "f32", "f"
    approximate = f'.approx.ftz.{suffix} %0, %1;" : "={register}"(r) : "{register}"(x));'

    @wp.func_native(f"""
        #if defined(__CUDA_ARCH__)
        {number} r; asm("rcp{approximate} {refine}
        #else
        return 1 / x;
        #endif
        """)
    def rcp(x: real) -> real: ...

    @wp.func_native(f"""
        x += {TINY[shape.precision]};
        #if defined(__CUDA_ARCH__)
        {number} r; asm("rsqrt{approximate} {refine_root}
        #else
        return wp::sqrt(x);
        #endif
        """)
    def root(x: real) -> real: ...

    # All 32 threads of a warp stay together until the last of their problems is done: the compiler
    # then needs nothing around a shuffle.
    def over_lanes(combine: str) -> str:
        """Return the body of a function that combines v over the lanes of a problem."""
        halves = [step for step in (1, 2, 4) if step < LANES]
        return f"""
            #if defined(__CUDA_ARCH__)
            {" ".join(combine.format(f"__shfl_xor_sync(~0u, v, {step})") for step in halves)}
            #endif
            return v;
            """

    @wp.func_native(over_lanes("v += {};"))
    def add_lanes(v: real) -> real: ...

    @wp.func_native(over_lanes("v = fmax(v, {});"))
    def max_lanes(v: real) -> real: ...

    @wp.func_native(f"""
        #if defined(__CUDA_ARCH__)
        const unsigned first = threadIdx.x & 31 & ~{LANES - 1}, lanes = {(1 << LANES) - 1};
        return (__ballot_sync(~0u, v) >> first & lanes) == lanes;
        #else
        return v;
        #endif
        """)
    def all_lanes(v: bool) -> bool: ...

    @wp.func_native("""
        #if defined(__CUDA_ARCH__)
        return __any_sync(~0u, v);
        #else
        return v;
        #endif
        """)
    def any_thread(v: bool) -> bool: ...

    @wp.func
    def larger(a: real, b: real) -> real:
        # Half the instructions of wp.max, which is exact about NaN.
        return wp.where(a > b, a, b)

    # H = L D Lᵀ of a packed lower triangle: L below the diagonal, 1/D on it. A pivot that is lost
    # to rounding is ``restored`` to a tiny positive one, or else its unknown is taken as zero: that
    # leaves out dependent rows of W.
    def make_factor(n: int, packed: Any, lost: float, restored: bool) -> Any:
        @wp.func
        def factor(H: packed) -> packed:
            L = packed()
            for e in range(n * (n + 1) // 2):
                L[e] = H[e]
            for j in range(n):
                pivot = L[j * (j + 3) // 2]
                least = R(lost) * H[j * (j + 3) // 2]
                inverse = rcp(larger(pivot, least))
                if wp.static(not restored):
                    inverse = wp.where(pivot > least, inverse, R(0.0))
                for back in range(n - 1 - j):
                    i = n - 1 - back
                    entry = L[i * (i + 1) // 2 + j] * inverse
                    for m in range(j + 1, i + 1):
                        L[i * (i + 1) // 2 + m] -= entry * L[m * (m + 1) // 2 + j]
                    L[i * (i + 1) // 2 + j] = entry
                L[j * (j + 3) // 2] = inverse
            return L

        return factor

    factor = make_factor(Q, vecL, LOST, restored=True)
    factor6 = make_factor(WRENCH, vec21, 100 * LOST, restored=False)

    # x ← L⁻¹ x, then x ← L⁻ᵀ D⁻¹ x.
    def make_substitutions(n: int, packed: Any, vector: Any) -> tuple[Any, Any]:
        @wp.func
        def forward(L: packed, b: vector) -> vector:
            x = vector()
            for i in range(n):
                v = b[i]
                for j in range(i):
                    v -= L[i * (i + 1) // 2 + j] * x[j]
                x[i] = v
            return x

        @wp.func
        def back(L: packed, y: vector) -> vector:
            x = vector()
            for up in range(n):
                i = n - 1 - up
                v = y[i] * L[i * (i + 3) // 2]
                for j in range(i + 1, n):
                    v -= L[j * (j + 1) // 2 + i] * x[j]
                x[i] = v
            return x

        return forward, back

    forward, back = make_substitutions(Q, vecL, vecQ)
    forward6, back6 = make_substitutions(WRENCH, vec21, vec6)

    # ---- a contact's numbers ---------------------------------------------------------------------

    @wp.func
    def dim_of(i: int) -> int:
        if wp.static(not MIXED):
            return Q
        return DIM[i]

    @wp.func
    def first_of(i: int) -> int:
        if wp.static(not MIXED):
            return Q * i
        return FIRST[i]

    # A floor at the ceiling, a set squeeze, leaves a band about both; one above it leaves nothing.

    @wp.func
    def raised(p: Inputs, b: int, i: int) -> bool:
        if wp.static(CEILINGS and FLOORS):
            return p.c_min[b, i] <= p.c_max[b, i] and R(ABOVE) * p.c_min[b, i] > p.c_max[b, i]
        return False

    @wp.func
    def lowered(p: Inputs, b: int, i: int) -> bool:
        if wp.static(CEILINGS and FLOORS):
            return p.c_min[b, i] <= p.c_max[b, i] and R(BELOW) * p.c_max[b, i] < p.c_min[b, i]
        return False

    @wp.func
    def ceiling_of(p: Inputs, b: int, i: int) -> real:
        if raised(p, b, i):
            return R(ABOVE) * p.c_min[b, i]
        return p.c_max[b, i]

    @wp.func
    def floor_of(p: Inputs, b: int, i: int) -> real:
        if lowered(p, b, i):
            return R(BELOW) * p.c_max[b, i]
        return p.c_min[b, i]

    @wp.func
    def read(p: Inputs, b: int, i: int) -> Contact:
        k = Contact()
        first = first_of(i)
        dim = dim_of(i)
        share = R(1.0)
        if wp.static(ENGAGEMENT):
            share = p.engagement[b, i]
        for a in range(Q):
            if a < dim:
                for r in range(WRENCH):
                    k.W[r, a] = p.W[b, r, first + a]
                for j in range(K):
                    k.J[a, j] = p.J[b, first + a, j]
        for j in range(K):
            bias = R(0.0)
            if wp.static(BIAS):
                bias = p.tau_bias[b, K * i + j]
            k.lo[j] = p.tau_lo[b, K * i + j] - bias
            k.hi[j] = p.tau_hi[b, K * i + j] - bias
        k.mu = R(1.0)
        k.torsion = R(1.0)
        if dim > 1:
            k.mu = p.mu[b, i]
        if wp.static(TORSION):
            if dim == 4:
                k.torsion = k.mu * rcp(p.gamma[b, i])
        k.ceiling = R(1e30)
        if wp.static(CEILINGS):
            k.ceiling = share * ceiling_of(p, b, i)
        if wp.static(FLOORS):
            k.floor = share * floor_of(p, b, i)
        k.there = R(1.0)
        return k

    @wp.func
    def idle() -> Contact:
        # Strictly inside limits of its own at a push of 1, and not felt by anything.
        k = Contact()
        k.mu = R(1.0)
        k.torsion = R(1.0)
        k.ceiling = R(2.0)
        for j in range(K):
            k.lo[j] = R(-1.0)
            k.hi[j] = R(1.0)
        return k

    @wp.func
    def takes_part(p: Inputs, b: int, i: int) -> bool:
        if i >= N:
            return False
        if wp.static(ENGAGEMENT):
            if p.engagement[b, i] <= R(REMOVAL_THRESHOLD):
                return False
        return True

    @wp.func
    def load(p: Inputs, b: int, i: int) -> Contact:
        if wp.static(IDLE):
            if not takes_part(p, b, i):
                return idle()
        return read(p, b, i)

    @wp.func
    def read_components(a: A2, b: int, i: int, k: Contact) -> vecQ:
        # The forces of a contact; of one out of the grasp, what is inside its limits.
        x = vecQ()
        if k.there > R(0.0):
            for j in range(Q):
                if j < dim_of(i):
                    x[j] = a[b, first_of(i) + j]
        if wp.static(IDLE):
            x[0] += R(1.0) - k.there
        return x

    @wp.func
    def write_components(a: A2, b: int, i: int, x: vecQ):
        for j in range(Q):
            if j < dim_of(i):
                a[b, first_of(i) + j] = x[j]

    # ---- cones and limits ------------------------------------------------------------------------

    @wp.func
    def weighted(x: vecQ, torsion: real) -> vecQ:
        # x with the torsion in units of the tangential force: the cone is mu n > ‖tangents‖.
        y = vecQ()
        for a in range(Q):
            y[a] = x[a]
        if wp.static(TORSION):
            y[3] = torsion * x[3]
        return y

    @wp.func
    def radius(y: vecQ) -> real:
        if wp.static(Q == 1):
            return R(0.0)
        s = R(0.0)
        for a in range(1, Q):
            s += y[a] * y[a]
        return root(s)

    @wp.func
    def torque(k: Contact, j: int, x: vecQ) -> real:
        t = R(0.0)
        for a in range(Q):
            t += k.J[a, j] * x[a]
        return t

    @wp.func
    def wrench(k: Contact, r: int, x: vecQ) -> real:
        t = R(0.0)
        for a in range(Q):
            t += k.W[r, a] * x[a]
        return t

    @wp.func
    def inside(c: vecQ, k: Contact) -> bool:
        strictly = k.mu * c[0] > radius(weighted(c, k.torsion))
        if wp.static(CEILINGS):
            strictly = strictly and k.ceiling > c[0]
        if wp.static(FLOORS):
            strictly = strictly and c[0] > k.floor
        for j in range(K):
            t = torque(k, j, c)
            strictly = strictly and k.hi[j] > t and t > k.lo[j]
        return strictly

    @wp.func
    def derivatives(c: vecQ, k: Contact, alpha: real):
        # Gradient of Phi, and packed lower triangle of its Hessian.
        g = vecQ()
        H = vecL()
        height = k.mu * c[0]
        y = weighted(c, k.torsion)
        r = radius(y)
        inverse = rcp((height - r) * (height + r))
        twice = R(2.0) * inverse
        y = weighted(y, k.torsion)
        g[0] = -twice * k.mu * height
        for a in range(1, Q):
            g[a] = twice * y[a]
        # g[0]² − 2 mu²/det without its difference of nearly equal terms.
        H[0] = twice * k.mu * k.mu * ((height * height + r * r) * inverse)
        for a in range(1, Q):
            for e in range(a):
                H[a * (a + 1) // 2 + e] = g[a] * g[e]
            w = R(1.0)
            if wp.static(TORSION):
                if a == 3:
                    w = k.torsion * k.torsion
            H[a * (a + 3) // 2] = g[a] * g[a] + twice * w
        if wp.static(CEILINGS):
            up = rcp(k.ceiling - c[0])
            g[0] += alpha * up
            H[0] += alpha * up * up
        if wp.static(FLOORS):
            down = rcp(c[0] - k.floor)
            g[0] -= alpha * down
            H[0] += alpha * down * down
        for j in range(K):
            t = torque(k, j, c)
            above = k.hi[j] - t
            below = t - k.lo[j]
            both = rcp(above * below)
            scaled = alpha * both
            slope = scaled * (below - above)
            bend = scaled * both * (above * above + below * below)
            for a in range(Q):
                g[a] += slope * k.J[a, j]
                bent = bend * k.J[a, j]
                for e in range(a + 1):
                    H[a * (a + 1) // 2 + e] += bent * k.J[e, j]
        return g, H

    @wp.func
    def used(above: real, below: real, change: real) -> real:
        # The share of the room on its side that a change takes up.
        return wp.abs(change) * rcp(wp.where(change > R(0.0), above, below))

    @wp.func
    def inverse_step_limit(c: vecQ, d: vecQ, k: Contact) -> real:
        # 1 / the largest t for which c + t d stays inside, so that the least limit is a maximum.
        # 0 or less: none.
        m = R(0.0)
        if wp.static(FLOORS):
            m = used(k.ceiling - c[0], c[0] - k.floor, d[0])
        elif wp.static(CEILINGS):
            m = used(k.ceiling - c[0], c[0], d[0])
        else:
            m = -d[0] * rcp(c[0])
        for j in range(K):
            t = torque(k, j, c)
            m = larger(m, used(k.hi[j] - t, t - k.lo[j], torque(k, j, d)))
        if wp.static(Q > 1):
            # The greater root of C x² + 2 B x + A in x = 1/t.
            y = weighted(c, k.torsion)
            z = weighted(d, k.torsion)
            r = radius(y)
            height = k.mu * c[0]
            rise = k.mu * d[0]
            A = rise * rise
            B = height * rise
            for a in range(1, Q):
                A -= z[a] * z[a]
                B -= y[a] * z[a]
            C = (height - r) * (height + r)
            D = B * B - A * C
            if D > R(0.0):
                m = larger(m, (root(D) - B) * rcp(C))
        return m

    @wp.func
    def push(k: Contact, fraction: real, otherwise: real) -> vecQ:
        # A pure push, a fraction of the way from the least to the greatest that the limits allow.
        least = k.floor
        most = k.ceiling
        for j in range(K):
            if k.J[0, j] != R(0.0):
                inverse = rcp(k.J[0, j])
                one = k.lo[j] * inverse
                other = k.hi[j] * inverse
                least = larger(least, wp.where(one < other, one, other))
                most = -larger(-most, -larger(one, other))
        if most >= R(1e30):
            most = least + otherwise
        c = vecQ()
        c[0] = least + fraction * (most - least)
        return c

    @wp.func
    def size(k: Contact) -> real:
        # The size of force that the limits are made for, by the largest of them.
        s = R(0.0)
        if wp.static(CEILINGS):
            s = k.ceiling
        for j in range(K):
            largest = R(0.0)
            for a in range(Q):
                largest = larger(largest, wp.abs(k.J[a, j]))
            if largest > R(0.0):
                s = larger(s, larger(wp.abs(k.lo[j]), wp.abs(k.hi[j])) * rcp(largest))
        return k.there * s

    # ---- the Newton step -------------------------------------------------------------------------

    @wp.func
    def add_schur(S: vec21, L: vecL, k: Contact) -> vec21:
        # S + W H⁻¹ Wᵀ
        T = vec21()
        Z = matW()
        for r in range(WRENCH):
            w = vecQ()
            for a in range(Q):
                w[a] = k.W[r, a]
            z = forward(L, w)
            scaled = vecQ()
            for a in range(Q):
                Z[r, a] = z[a]
                scaled[a] = z[a] * L[a * (a + 3) // 2]
            for s in range(r + 1):
                t = S[r * (r + 1) // 2 + s]
                for a in range(Q):
                    t += scaled[a] * Z[s, a]
                T[r * (r + 1) // 2 + s] = t
        return T

    @wp.func
    def solve_schur(S: vec21, r: vec6) -> vec6:
        L = factor6(S)
        return back6(L, forward6(L, r))

    @wp.func
    def along_contact(k: Contact, x: vec6) -> vecQ:
        # Wᵀ x
        y = vecQ()
        for a in range(Q):
            t = R(0.0)
            for r in range(WRENCH):
                t += k.W[r, a] * x[r]
            y[a] = t
        return y

    # ---- kernels ---------------------------------------------------------------------------------

    options: dict[str, Any] = {
        "enable_backward": False,
        "module": "unique",
        "grid_stride": False,
        "module_options": {"max_unroll": 16 if LANES > 1 else 1},
        "launch_bounds": (THREADS, BLOCKS[shape.precision]),
    }

    @wp.kernel(**options)
    def solve(p: Inputs, start: A2, out: Outputs, tol: real, max_steps: int):
        tid = wp.tid()
        count = p.f.shape[0]
        lane = tid % LANES
        go = tid < count * LANES
        b = wp.min(tid // LANES, count - 1)
        alpha = p.alpha[b]
        c = pointsQ()
        d = pointsQ()
        g = pointsQ()
        L = pointsL()
        k = load(p, b, lane)

        started = bool(False)
        if start:
            started = bool(True)
            for j in range(PER_THREAD):
                if wp.static(PER_THREAD > 1):
                    k = load(p, b, j)
                at = read_components(start, b, lane + j * LANES, k)
                started = started and inside(at, k)
                c[j] = at
            started = all_lanes(started)
        if not started:
            fraction = rcp(root(R(4.0) + R(3.0) * alpha))
            otherwise = R(1.0)
            for r in range(WRENCH):
                otherwise += wp.abs(p.f[b, r])
            for j in range(PER_THREAD):
                if wp.static(PER_THREAD > 1):
                    k = load(p, b, j)
                c[j] = push(k, fraction, otherwise)

        steps = int(0)
        status = int(MAX_STEPS)
        balanced = bool(False)
        while any_thread(go):
            S = vec21()
            missing = vec6()
            well = bool(True)
            if lane == 0:
                for r in range(WRENCH):
                    missing[r] = p.f[b, r]
            for j in range(PER_THREAD):
                if wp.static(PER_THREAD > 1):
                    k = load(p, b, j)
                at = c[j]
                well = well and inside(at, k)
                gradient, H = derivatives(at, k, alpha)
                F = factor(H)
                S = add_schur(S, F, k)
                x = back(F, forward(F, gradient)) - at
                for r in range(WRENCH):
                    missing[r] += wrench(k, r, x)
                g[j] = gradient
                L[j] = F
            well = all_lanes(well)
            for e in range(LOWER6):
                S[e] = add_lanes(S[e])
            for r in range(WRENCH):
                missing[r] = add_lanes(missing[r])
            nu = solve_schur(S, missing)
            squared = R(0.0)
            for j in range(PER_THREAD):
                if wp.static(PER_THREAD > 1):
                    k = load(p, b, j)
                F = L[j]
                u = along_contact(k, nu) - g[j]
                if wp.static(IDLE):
                    u = u * k.there
                y = forward(F, u)
                for a in range(Q):
                    squared += y[a] * y[a] * F[a * (a + 3) // 2]
                d[j] = back(F, y)
            # The decrement is that of Phi / min(1, alpha), which is standard self-concordant.
            squared = add_lanes(squared) * rcp(wp.where(alpha < R(1.0), alpha, R(1.0)))

            taken = R(1.0)
            if any_thread(go and squared >= R(0.0625)):
                m = R(0.0)
                for j in range(PER_THREAD):
                    if wp.static(PER_THREAD > 1):
                        k = load(p, b, j)
                    m = larger(m, inverse_step_limit(c[j], d[j], k))
                m = max_lanes(m)
                if squared >= R(0.0625) and m > R(0.9):
                    taken = R(0.9) * rcp(m)
            if go:
                if not well:  # the start is outside, or rounding put the point there
                    status = STALLED
                    go = False
                elif not (squared < R(1e30) and alpha > R(0.0)):
                    status = INVALID_NUMBERS
                    go = False
                else:
                    steps += 1
                    for j in range(PER_THREAD):
                        c[j] = c[j] + taken * d[j]
                    if taken == R(1.0):
                        # The whole step is taken first, and judged by the bound that its decrement
                        # sets on the one behind it.
                        balanced = True
                        lam = root(squared)
                        ratio = lam * rcp(R(1.0) - lam)
                        if lam < R(0.99) and ratio * ratio * ratio * ratio <= R(2.0) * tol:
                            status = SOLVED
                            go = False
                    if steps >= max_steps or (steps >= MAX_UNBALANCED_STEPS and not balanced):
                        go = False
                if not go:
                    for r in range(WRENCH):
                        if r % LANES == lane:
                            out.nu[b, r] = nu[r]

        # Another look, from the numbers alone, at what SOLVED claims.
        error = vec6()
        total = vec6()
        made_for = R(0.0)
        force = R(0.0)
        well = bool(True)
        if lane == 0:
            for r in range(WRENCH):
                error[r] = p.f[b, r]
                total[r] = wp.abs(error[r])
                made_for = larger(made_for, total[r])
        for j in range(PER_THREAD):
            if wp.static(PER_THREAD > 1):
                k = load(p, b, j)
            at = c[j]
            well = well and inside(at, k)
            made_for = larger(made_for, size(k))
            for a in range(Q):
                force = larger(force, k.there * wp.abs(at[a]))
            for r in range(WRENCH):
                error[r] -= wrench(k, r, at)
                for a in range(Q):
                    total[r] += wp.abs(k.W[r, a] * at[a])
        largest_error = R(0.0)
        largest_total = R(0.0)
        for r in range(WRENCH):
            largest_error = larger(largest_error, wp.abs(add_lanes(error[r])))
            largest_total = larger(largest_total, add_lanes(total[r]))
        made_for = max_lanes(made_for)
        force = max_lanes(force)
        well = all_lanes(well)
        if status == SOLVED:
            if force > R(RUNAWAY) * made_for:
                status = UNBOUNDED
            elif not (well and largest_error <= R(BALANCE) * largest_total):
                status = STALLED

        if tid < count * LANES:
            for j in range(PER_THREAD):
                i = lane + j * LANES
                if i < N:
                    if wp.static(PER_THREAD > 1):
                        k = load(p, b, j)
                    at = k.there * c[j]
                    write_components(out.c, b, i, at)
                    if out.tau:
                        for e in range(K):
                            bias = R(0.0)
                            if wp.static(BIAS):
                                bias = p.tau_bias[b, K * i + e]
                            out.tau[b, K * i + e] = torque(k, e, at) + bias
            if lane == 0:
                out.status[b] = status
                out.newton_steps[b] = steps

    # With Phi's Hessian H at the optimum, H p + Wᵀ q = v and W p = 0 turn v = dL/dc into
    # dL/df = q, dL/dW = nu pᵀ − q cᵀ and, for any number t in Phi, dL/dt = −p·∂(∇Phi)/∂t.

    @wp.func
    def contact_gradient(c: vecQ, p: vecQ, k: Contact, nu: vec6, q: vec6, alpha: real) -> Contact:
        G = Contact()  # dL by each of a contact's numbers; its c is 0 where it is out of the grasp
        for r in range(WRENCH):
            for a in range(Q):
                G.W[r, a] = nu[r] * p[a] - q[r] * k.there * c[a]
        height = k.mu * c[0]
        y = weighted(c, k.torsion)
        z = weighted(p, k.torsion)
        rho = radius(y)
        inverse = rcp((height - rho) * (height + rho))
        s = height * k.mu * p[0]  # p·∇(−ln det) = −2 s / det
        for a in range(1, Q):
            s -= y[a] * z[a]
        scaled = R(2.0) * inverse
        G.mu = R(2.0) * scaled * k.mu * c[0] * (p[0] - s * inverse * c[0])
        if wp.static(TORSION):
            G.torsion = R(2.0) * scaled * k.torsion * c[3] * (s * inverse * c[3] - p[3])
        if wp.static(CEILINGS):
            up = rcp(k.ceiling - c[0])
            G.ceiling = alpha * p[0] * up * up
        if wp.static(FLOORS):
            down = rcp(c[0] - k.floor)
            G.floor = alpha * p[0] * down * down
        for j in range(K):
            t = torque(k, j, c)
            along = torque(k, j, p)
            up = rcp(k.hi[j] - t)
            down = rcp(t - k.lo[j])
            G.hi[j] = alpha * along * up * up
            G.lo[j] = alpha * along * down * down
            bend = along * (up * up + down * down)
            for a in range(Q):
                G.J[a, j] = -alpha * ((up - down) * p[a] + bend * c[a])
        return G

    @wp.func
    def limits_along(c: vecQ, p: vecQ, k: Contact) -> real:
        # p·∇Phi_lin
        s = R(0.0)
        if wp.static(CEILINGS):
            s += p[0] * rcp(k.ceiling - c[0])
        if wp.static(FLOORS):
            s -= p[0] * rcp(c[0] - k.floor)
        for j in range(K):
            t = torque(k, j, c)
            s += torque(k, j, p) * (rcp(k.hi[j] - t) - rcp(t - k.lo[j]))
        return s

    @wp.func
    def store(p: Inputs, by: Inputs, b: int, i: int, k: Contact, G: Contact):
        # The gradients of contact i by what its numbers are made of, as far as they are wanted.
        first = first_of(i)
        dim = dim_of(i)
        for a in range(Q):
            if a < dim:
                if by.W:
                    for r in range(WRENCH):
                        by.W[b, r, first + a] = G.W[r, a]
                if by.J:
                    for j in range(K):
                        by.J[b, first + a, j] = G.J[a, j]
        for j in range(K):
            if by.tau_lo:
                by.tau_lo[b, K * i + j] = G.lo[j]
            if by.tau_hi:
                by.tau_hi[b, K * i + j] = G.hi[j]
            if by.tau_bias:
                by.tau_bias[b, K * i + j] -= G.lo[j] + G.hi[j]
        by_mu = G.mu
        by_gamma = R(0.0)
        if wp.static(TORSION):
            if dim == 4:
                inverse = rcp(p.gamma[b, i])
                by_mu += G.torsion * inverse
                by_gamma = -G.torsion * k.torsion * inverse
        if by.mu:
            by.mu[b, i] = wp.where(dim == 1, R(0.0), by_mu)
        if by.gamma:
            by.gamma[b, i] = by_gamma
        share = R(1.0)
        if wp.static(ENGAGEMENT):
            share = k.there * p.engagement[b, i]
            if by.engagement:
                total = R(0.0)
                if wp.static(CEILINGS):
                    total += G.ceiling * ceiling_of(p, b, i)
                if wp.static(FLOORS):
                    total += G.floor * floor_of(p, b, i)
                by.engagement[b, i] = total
        # Where a set squeeze moves a bound away from the other, that other is what it follows.
        by_ceiling = share * G.ceiling
        by_floor = share * G.floor
        if by.c_max:
            by.c_max[b, i] = wp.where(raised(p, b, i), R(0.0), by_ceiling)
            if lowered(p, b, i):
                by.c_max[b, i] += R(BELOW) * by_floor
        if by.c_min:
            by.c_min[b, i] = wp.where(lowered(p, b, i), R(0.0), by_floor)
            if raised(p, b, i):
                by.c_min[b, i] += R(ABOVE) * by_ceiling

    @wp.kernel(**options)
    def vjp(p: Inputs, out: Outputs, by_c: A2, by_tau: A2, by: Inputs):
        tid = wp.tid()
        count = p.f.shape[0]
        lane = tid % LANES
        b = wp.min(tid // LANES, count - 1)
        mine = tid < count * LANES
        solved = out.status[b] == SOLVED
        alpha = p.alpha[b]
        k = load(p, b, lane)
        v = pointsQ()
        c = pointsQ()
        L = pointsL()
        S = vec21()
        right = vec6()
        nu = vec6()
        for r in range(WRENCH):
            nu[r] = out.nu[b, r]
        for j in range(PER_THREAD):
            if wp.static(PER_THREAD > 1):
                k = load(p, b, j)
            i = lane + j * LANES
            at = read_components(out.c, b, i, k)
            wanted = vecQ()
            if by_c:
                wanted = read_components(by_c, b, i, k)
            if by_tau:
                if i < N:
                    for e in range(K):
                        for a in range(Q):
                            wanted[a] += k.J[a, e] * by_tau[b, K * i + e]
            _, H = derivatives(at, k, alpha)
            F = factor(H)
            S = add_schur(S, F, k)
            x = back(F, forward(F, wanted))
            for r in range(WRENCH):
                right[r] += wrench(k, r, x)
            v[j] = wanted
            c[j] = at
            L[j] = F
        for e in range(LOWER6):
            S[e] = add_lanes(S[e])
        for r in range(WRENCH):
            right[r] = add_lanes(right[r])
        q = solve_schur(S, right)

        by_alpha = R(0.0)
        for j in range(PER_THREAD):
            if wp.static(PER_THREAD > 1):
                k = load(p, b, j)
            i = lane + j * LANES
            F = L[j]
            u = v[j] - along_contact(k, q)
            if wp.static(IDLE):
                u = u * k.there
            x = back(F, forward(F, u))
            by_alpha -= limits_along(c[j], x, k)
            if mine and i < N:
                G = Contact()
                if solved:
                    G = contact_gradient(c[j], x, k, nu, q, alpha)
                for e in range(K):
                    torque_gradient = R(0.0)
                    if solved and by_tau:
                        torque_gradient = by_tau[b, K * i + e]
                    for a in range(Q):
                        G.J[a, e] += torque_gradient * k.there * c[j, a]
                    if by.tau_bias:
                        by.tau_bias[b, K * i + e] = torque_gradient
                store(p, by, b, i, k, G)
        by_alpha = add_lanes(by_alpha)
        if mine:
            if by.f:
                for r in range(WRENCH):
                    if r % LANES == lane:
                        by.f[b, r] = wp.where(solved, q[r], R(0.0))
            if by.alpha:
                if lane == 0:
                    by.alpha[b] = wp.where(solved, by_alpha, R(0.0))

    return Kernels(solve, vjp, Inputs, Outputs, real)
