"""Answers in the user's terms, made of ``solve`` and ``Servo``: newtons, percent and fingers.

======================  ===============================================================
``firmness``            how firm a grip is and shall be, in place of alpha
``diagnosis``           why there is no answer, and what would help
``payload``             how much more the grasp can carry, in one direction and in all
``robust``              forces that hold for whole sets of frictions, contacts and wrenches
``regrasp``             which finger can leave, when and how fast
======================  ===============================================================

They are ``gf.firmness``, ``gf.diagnose``, ``gf.payload``, ``gf.robust`` and ``gf.regrasp``.
"""
