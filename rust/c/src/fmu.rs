//! What both versions of FMI have in common: an instance of the model in the resources of its unit.
//!
//! Value references count inputs, then outputs, then parameters, then time.

use std::ffi::{CStr, c_char, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::slice;

use ambid_core::{ClosedLoop, Packed, Stepper};

use crate::stepper::read;

/// The model, as `ambid export --fmu` names it.
const MODEL: &str = "model.stepper";
/// Part of a sample by which a communication step may miss whole samples: times are sums with rounding.
const ROUNDING: f64 = 1e-6;

/// Status of both versions.
pub const OK: i32 = 0;
pub const ERROR: i32 = 3;

/// What reports to the importer what went wrong.
pub type Log = Rc<dyn Fn(&str)>;

pub struct Instance {
    packed: Packed,
    system: ClosedLoop,
    stepper: Stepper,
    theta: Vec<f64>,
    u: Vec<f64>,
    y: Vec<f64>,
    time: f64,
    /// Whether parameters may still be set.
    in_preparation: bool,
    /// Whether the stepper was made with other parameters.
    is_old: bool,
    /// Whether y is not that of now.
    is_stale: bool,
    log: Log,
}

impl Instance {
    /// Reads the model of a unit with this token.
    fn new(resources: &Path, token: &str, log: Log) -> Result<Self, String> {
        let path = resources.join(MODEL);
        let bytes = read(&path)?;
        let wrong = |error: ambid_core::Error| format!("{}: {error}", path.display());
        let packed = Packed::from_bytes(&bytes).map_err(wrong)?;
        let own = bytes.last_chunk().map_or(0, |check| u64::from_le_bytes(*check));
        if token != format!("{own:016x}") {
            return Err(format!("the description of the unit has the token {token}, its model {own:016x}"));
        }
        let system = packed.system().map_err(wrong)?;
        let theta = packed.theta.clone();
        let stepper = Stepper::new(&system, &theta).map_err(wrong)?;
        let (u, y) = (vec![0.0; stepper.inputs()], vec![0.0; stepper.outputs()]);
        Ok(Self {
            packed,
            system,
            stepper,
            theta,
            u,
            y,
            time: 0.0,
            in_preparation: true,
            is_old: false,
            is_stale: true,
            log,
        })
    }

    pub fn start(&mut self, time: f64) -> Result<(), String> {
        self.time = time;
        Ok(())
    }

    /// Takes the parameters as they are; they are fixed from now on.
    pub fn begin(&mut self) -> Result<(), String> {
        self.renew()?;
        self.in_preparation = false;
        Ok(())
    }

    /// As it was when it was made.
    pub fn reset(&mut self) -> Result<(), String> {
        self.is_old |= self.theta != self.packed.theta;
        self.theta.copy_from_slice(&self.packed.theta);
        self.renew()?;
        self.stepper.reset();
        self.u.fill(0.0);
        (self.time, self.in_preparation, self.is_stale) = (0.0, true, true);
        Ok(())
    }

    /// Makes the stepper anew where parameters were set.
    fn renew(&mut self) -> Result<(), String> {
        if self.is_old {
            self.stepper = Stepper::new(&self.system, &self.theta).map_err(|error| error.to_string())?;
            self.is_old = false;
        }
        Ok(())
    }

    pub fn get(&mut self, references: &[u32], values: &mut [f64]) -> Result<(), String> {
        if references.len() != values.len() {
            return Err(format!("{} variables, but {} values", references.len(), values.len()));
        }
        for (reference, value) in references.iter().zip(values) {
            *value = self.value(*reference as usize)?;
        }
        Ok(())
    }

    fn value(&mut self, reference: usize) -> Result<f64, String> {
        let (inputs, outputs) = (self.u.len(), self.u.len() + self.y.len());
        let time = outputs + self.theta.len();
        if reference < inputs {
            return Ok(self.u[reference]);
        }
        if reference < outputs {
            if self.is_stale {
                self.renew()?;
                self.stepper.outputs_now(&self.u, &mut self.y).map_err(|error| error.to_string())?;
                self.is_stale = false;
            }
            return Ok(self.y[reference - inputs]);
        }
        if reference == time {
            return Ok(self.time);
        }
        self.theta.get(reference - outputs).copied().ok_or_else(|| format!("there is no variable {reference}"))
    }

    pub fn set(&mut self, references: &[u32], values: &[f64]) -> Result<(), String> {
        if references.len() != values.len() {
            return Err(format!("{} variables, but {} values", references.len(), values.len()));
        }
        let (inputs, first) = (self.u.len(), self.u.len() + self.y.len());
        for (reference, value) in references.iter().zip(values) {
            let place = *reference as usize;
            if !value.is_finite() {
                return Err(format!("variable {place} is to become {value}; expected a finite number"));
            }
            if place < inputs {
                self.u[place] = *value;
            } else if place >= first && place - first < self.theta.len() {
                if !self.in_preparation {
                    let name = &self.packed.parameters[place - first];
                    return Err(format!("{name} is fixed; set it before the initialization ends"));
                }
                self.theta[place - first] = *value;
                self.is_old = true;
            } else {
                return Err(format!("variable {place} is no input and no parameter, and cannot be set"));
            }
            self.is_stale = true;
        }
        Ok(())
    }

    /// Goes on by whole samples; what is set is held over them.
    pub fn step(&mut self, from: f64, length: f64) -> Result<(), String> {
        let dt = self.packed.model.dt;
        let (samples, whole) = (length / dt, (length / dt).round());
        if !(whole >= 1.0 && (samples - whole).abs() < ROUNDING * whole.max(1.0) && whole < u32::MAX.into()) {
            return Err(format!(
                "a communication step of {length} s is {samples} samples; expected a whole multiple of the sample \
                 time {dt} s"
            ));
        }
        self.begin()?;
        for _ in 0..whole as u32 {
            self.stepper.step(&self.u, &mut self.y).map_err(|error| error.to_string())?;
        }
        if self.y.iter().any(|y| !y.is_finite()) {
            return Err(format!("the loop diverges: an output is not finite after {from} s"));
        }
        (self.time, self.is_stale) = (from + length, true);
        Ok(())
    }
}

/// Makes an instance, or states why not.
///
/// # Safety
/// `token` is NULL or ends with a zero byte.
pub unsafe fn instantiate(token: *const c_char, resources: Option<PathBuf>, log: Log) -> *mut c_void {
    // SAFETY: the caller's promise.
    let token = if token.is_null() { "" } else { unsafe { CStr::from_ptr(token) }.to_str().unwrap_or("") };
    let own = Rc::clone(&log);
    let made = guard(|| {
        let resources = resources.ok_or("the place of the resources is missing, or no local file")?;
        Instance::new(&resources, token, own)
    });
    match made {
        Ok(instance) => Box::into_raw(Box::new(instance)).cast(),
        Err(what) => {
            log(&what);
            std::ptr::null_mut()
        }
    }
}

/// Does something with an instance; what goes wrong is logged.
///
/// # Safety
/// `instance` is NULL or comes from [`instantiate`].
pub unsafe fn with(instance: *mut c_void, work: impl FnOnce(&mut Instance) -> Result<(), String>) -> i32 {
    // SAFETY: the caller's promise.
    let Some(own) = (unsafe { instance.cast::<Instance>().as_mut() }) else { return ERROR };
    let Err(what) = guard(|| work(own)) else { return OK };
    (own.log)(&what);
    ERROR
}

/// No panic leaves the library.
fn guard<T>(work: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    let done = catch_unwind(AssertUnwindSafe(work));
    done.unwrap_or_else(|_| Err("a mistake in the library; please report it".to_owned()))
}

/// # Safety
/// `instance` is NULL or comes from [`instantiate`], and is not used any more.
pub unsafe fn free(instance: *mut c_void) {
    if !instance.is_null() {
        // SAFETY: the caller's promise.
        drop(unsafe { Box::from_raw(instance.cast::<Instance>()) });
    }
}

/// Numbers of the importer, none where there is no memory.
///
/// # Safety
/// `values` is NULL or points to `count` numbers.
pub unsafe fn numbers<'a, T>(values: *const T, count: usize) -> &'a [T] {
    // SAFETY: the caller's promise.
    if values.is_null() { &[] } else { unsafe { slice::from_raw_parts(values, count) } }
}

/// The same, to be written.
///
/// # Safety
/// As [`numbers`].
pub unsafe fn numbers_mut<'a, T>(values: *mut T, count: usize) -> &'a mut [T] {
    // SAFETY: the caller's promise.
    if values.is_null() { &mut [] } else { unsafe { slice::from_raw_parts_mut(values, count) } }
}
