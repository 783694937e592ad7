"""What a force loop needs beside the Servo: contacts that come and go, and position-driven motors.

:class:`ContactBook` makes of what touches now a problem of one layout whose numbers change
little; :func:`position_command` sends torques through motors that take positions. Neither knows a
simulator.
"""

from graspforce.control.contact_book import ContactBook
from graspforce.control.position import PositionCommand, position_command

__all__ = ["ContactBook", "PositionCommand", "position_command"]
