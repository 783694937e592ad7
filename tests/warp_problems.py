"""Random problems of one layout, as arrays with a row each."""

import numpy as np
from grasps import SIZES, random_contacts, random_model, unit

import graspforce as gf


def random_batch(
    rng, kinds, B, *, joints=3, ceilings=True, floors=False, engagement=False, bias=False
):
    """Grasps of fingertips around an object with loads that some of them cannot hold.

    Args:
        rng: where the numbers come from.
        kinds: contact kinds, names of ``grasps.KINDS``.
        B: number of problems.
        joints: of each finger; 0 for no hand.
        ceilings: limit the normal forces from above.
        floors: and from below.
        engagement: scale both; one contact in ten is out of the grasp.
        bias: give the joints torques of their own.

    Returns:
        The arrays by the names of ForceProblem's arguments, and models that fix the layout.
    """
    n, sizes = len(kinds), [SIZES[kind] for kind in kinds]
    grasps = [random_contacts(rng, [random_model(rng, kind) for kind in kinds]) for _ in range(B)]
    force = unit(rng.normal(size=(B, 3)))
    load = np.exp(rng.uniform(np.log(0.1), np.log(6), (B, 1)))
    W = np.stack([gf.grasp_map(contacts) for contacts in grasps])
    f = load * np.hstack((force, 0.02 * rng.normal(size=(B, 3))))
    if n == 2:  # two contacts make only some wrenches
        scale = np.concatenate([[1, 0.1, 0.1, 0.001][:size] for size in sizes])
        c = np.abs(rng.normal(size=(B, sum(sizes)))) * scale
        f = np.einsum("brm,bm->br", W, c)
    coefficient = {
        name: np.array([[getattr(c.model, name, 1.0) for c in contacts] for contacts in grasps])
        for name in ("mu", "gamma")
    }  # fmt: skip
    arrays = {"W": W, "f": f, **coefficient, "alpha": np.exp(rng.uniform(-1.5, 3, B))}
    if joints:
        J = rng.normal(0, 0.05, (B, sum(sizes), joints))
        soft = np.concatenate([[1, 1, 1, 20][:size] for size in sizes])
        arrays["J"] = J * soft[:, np.newaxis]
        shape = (B, n * joints)
        arrays |= {"tau_lo": -rng.uniform(0.2, 0.8, shape), "tau_hi": rng.uniform(0.2, 0.8, shape)}
        if bias:
            arrays["tau_bias"] = rng.normal(0, 0.05, shape)
    if ceilings:
        arrays["c_max"] = rng.uniform(10, 30, (B, n))
    if floors:
        arrays["c_min"] = rng.uniform(0, 0.1, (B, n))
    if engagement:
        arrays["engagement"] = np.where(rng.random((B, n)) < 0.1, 0.0, rng.uniform(0.3, 1, (B, n)))
    return arrays, [contact.model for contact in grasps[0]]
