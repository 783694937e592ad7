// hold_cube.c in Rust, without crates:
//
//     rustc --edition 2021 -O -L /where/it/went/lib hold_cube.rs
use std::ffi::{c_char, c_double, c_int, c_void, CStr};
use std::ptr::null_mut;

#[link(name = "graspforce")]
extern "C" {
    fn graspforce_create(
        wrench_rows: c_int, contacts: c_int, models: *const c_int, joints: c_int,
        inequalities: c_int, optional: *const c_char,
    ) -> *mut c_void;
    fn graspforce_destroy(servo: *mut c_void);
    fn graspforce_error() -> *const c_char;
    fn graspforce_field(
        servo: *mut c_void, name: *const c_char, rows: *mut c_int, columns: *mut c_int,
    ) -> *mut c_double;
    fn graspforce_write_contact(
        servo: *mut c_void, contact: c_int, point: *const c_double, normal: *const c_double,
        tangent: *const c_double,
    ) -> c_int;
    fn graspforce_tick(servo: *mut c_void) -> c_int;
    fn graspforce_forces(servo: *const c_void) -> *const c_double;
    fn graspforce_status_name(status: c_int) -> *const c_char;
}

const PCWF: c_int = 3;
const SOLVED: c_int = 0;

fn words(text: *const c_char) -> String {
    unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
}

// A servo that is destroyed with its owner.
struct Servo(*mut c_void);

impl Servo {
    fn new(contacts: &[c_int], joints: c_int, optional: &CStr) -> Result<Self, String> {
        let servo = unsafe {
            let count = contacts.len() as c_int;
            graspforce_create(6, count, contacts.as_ptr(), joints, 0, optional.as_ptr())
        };
        if servo.is_null() { Err(words(unsafe { graspforce_error() })) } else { Ok(Servo(servo)) }
    }

    fn field(&mut self, name: &CStr) -> &mut [f64] {
        let (mut rows, mut columns) = (0, 0);
        let first = unsafe { graspforce_field(self.0, name.as_ptr(), &mut rows, &mut columns) };
        assert!(!first.is_null(), "no field {name:?}");
        unsafe { std::slice::from_raw_parts_mut(first, (rows * columns) as usize) }
    }

    fn write_contact(&mut self, i: usize, point: [f64; 3], normal: [f64; 3], tangent: [f64; 3]) {
        let done = unsafe {
            let (p, n, t) = (point.as_ptr(), normal.as_ptr(), tangent.as_ptr());
            graspforce_write_contact(self.0, i as c_int, p, n, t)
        };
        assert_eq!(done, 0, "contact {i}");
    }

    fn tick(&mut self, components: usize) -> Result<&[f64], String> {
        let status = unsafe { graspforce_tick(self.0) };
        if status != SOLVED {
            return Err(words(unsafe { graspforce_status_name(status) }));
        }
        Ok(unsafe { std::slice::from_raw_parts(graspforce_forces(self.0), components) })
    }
}

impl Drop for Servo {
    fn drop(&mut self) {
        unsafe { graspforce_destroy(std::mem::replace(&mut self.0, null_mut())) }
    }
}

fn main() -> Result<(), String> {
    let name = |bytes: &'static [u8]| CStr::from_bytes_with_nul(bytes).unwrap();
    let mut servo = Servo::new(&[PCWF; 4], 0, name(b"c_max\0"))?;
    let half = 0.0375; // of the cube's side [m]
    for (i, (x, y)) in [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)].into_iter().enumerate() {
        servo.write_contact(i, [half * x, half * y, 0.0], [-x, -y, 0.0], [0.0, 0.0, 1.0]);
        servo.field(name(b"mu\0"))[i] = 0.5;
        servo.field(name(b"c_max\0"))[i] = 20.0; // [N]
    }
    servo.field(name(b"f\0"))[2] = 0.25 * 9.81; // against gravity [N]
    for engagement in [1.0, 0.5, 0.1, 0.0, 0.1, 1.0] {
        servo.field(name(b"engagement\0"))[3] = engagement; // of the last finger
        let forces: Vec<String> = servo.tick(12)?.iter().map(|c| format!("{c:e}")).collect();
        println!("{}", forces.join(" "));
    }
    Ok(())
}
