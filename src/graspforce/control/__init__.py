"""What a force loop needs beside the Servo: which wrench to ask for, contacts, position commands.

:class:`ObjectLaw` says which wrench brings an object to where it should be; :class:`ContactBook`
makes of contacts that come and go a problem of one layout whose numbers change little;
:func:`position_command` sends torques through motors that take positions. None knows a simulator.
"""

from graspforce.control.contact_book import ContactBook
from graspforce.control.object_law import ObjectLaw, ObjectState
from graspforce.control.position import PositionCommand, position_command

__all__ = ["ContactBook", "ObjectLaw", "ObjectState", "PositionCommand", "position_command"]
