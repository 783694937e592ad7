"""The other methods of the paper's Sections I and IV-B.3, each on the same ForceProblem.

One file a method, each with ``solve(problem, …) -> Solution``: the same statuses, residuals and
margins as :func:`graspforce.solve`. ``newton_steps`` counts the iterations of the method, and
``nu`` belongs to its own objective. A method whose optimum lies on the boundary (a linear
objective without barrier, say) returns forces with margins of zero to its precision, for which
``Solution.verify()`` is not ok.

Methods by a foreign solver also have ``Prepared(problem, …)``, whose ``solve(problem)`` keeps the
solver's workspace over a stream of problems.
"""

from __future__ import annotations

METHODS: dict[str, str] = {
    "compact_dual": "graspforce.baselines.compact_dual",
    "dikin": "graspforce.baselines.dikin",
    "gradient_flow": "graspforce.baselines.gradient_flow",
    "lp": "graspforce.baselines.lp",
    "minimum_norm": "graspforce.baselines.minimum_norm",
    "neural_network": "graspforce.baselines.neural_network",
    "qp": "graspforce.baselines.qp",
    "sdp": "graspforce.baselines.sdp",
    "socp": "graspforce.baselines.socp",
    "wbf_conic": "graspforce.baselines.wbf_conic",
}
"""The module of every method, by its name."""
