"""hold_cube.c by ctypes, without graspforce's Python package: any language that calls C can do it.

python hold_cube.py /where/it/went/lib/libgraspforce.so
"""

import ctypes
import sys

lib = ctypes.CDLL(sys.argv[1])
doubles, servo_p = ctypes.POINTER(ctypes.c_double), ctypes.c_void_p
lib.graspforce_create.restype = servo_p
lib.graspforce_error.restype = lib.graspforce_status_name.restype = ctypes.c_char_p
lib.graspforce_field.restype = lib.graspforce_forces.restype = doubles
lib.graspforce_field.argtypes = [servo_p, ctypes.c_char_p, servo_p, servo_p]
lib.graspforce_write_contact.argtypes = [servo_p, ctypes.c_int, doubles, doubles, doubles]
for function in (lib.graspforce_tick, lib.graspforce_forces, lib.graspforce_destroy):
    function.argtypes = [servo_p]
if lib.graspforce_abi() != 1:
    sys.exit("the library is of another version than this program")

PCWF = 3
servo = lib.graspforce_create(6, 4, (ctypes.c_int * 4)(PCWF, PCWF, PCWF, PCWF), 0, 0, b"c_max")
if not servo:
    sys.exit(lib.graspforce_error().decode())


def field(name: bytes) -> "ctypes._Pointer[ctypes.c_double]":
    return lib.graspforce_field(servo, name, None, None)


half = 0.0375  # of the cube's side [m]
vector = ctypes.c_double * 3
for i, (x, y) in enumerate([(1, 0), (0, 1), (-1, 0), (0, -1)]):
    point, normal = vector(half * x, half * y, 0), vector(-x, -y, 0)
    lib.graspforce_write_contact(servo, i, point, normal, vector(0, 0, 1))
    field(b"mu")[i] = 0.5
    field(b"c_max")[i] = 20  # [N]
field(b"f")[2] = 0.25 * 9.81  # against gravity [N]

for engagement in (1, 0.5, 0.1, 0, 0.1, 1):  # of the last finger
    field(b"engagement")[3] = engagement
    status = lib.graspforce_tick(servo)
    if status != 0:
        sys.exit(lib.graspforce_status_name(status).decode())
    print(*(repr(force) for force in lib.graspforce_forces(servo)[:12]))
lib.graspforce_destroy(servo)
