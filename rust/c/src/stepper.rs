//! The C interface: load a file of `ambid export --stepper`, step, reset, free.

use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::fs::File;
use std::io::Read;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::slice;

use ambid_core::{Error, Packed, Stepper};

/// Largest file that is read: a loop of 1024 states has 30 MB.
const LARGEST_FILE: u64 = 1 << 26;

/// What a call did.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AmbidStatus {
    /// Done.
    Ok = 0,
    /// A pointer is NULL.
    Null = 1,
    /// The file cannot be read.
    File = 2,
    /// The bytes are no stepper file, or a broken one.
    Format = 3,
    /// A number of inputs or outputs is not that of the loop.
    Size = 4,
    /// An input is NaN or infinite.
    NotFinite = 5,
    /// A mistake in the library.
    Internal = 6,
}

/// A loop under way. One thread at a time may use it.
pub struct AmbidStepper {
    stepper: Stepper,
    sample_time: f64,
    inputs: Vec<CString>,
    outputs: Vec<CString>,
}

thread_local! {
    static LAST_ERROR: RefCell<CString> = RefCell::default();
}

/// Reads a file that `ambid export MODEL --stepper FILE` wrote; the loop is at rest.
///
/// `*stepper` becomes the loop, to be given back by `ambid_free`, or NULL.
///
/// # Safety
/// `path` is NULL or ends with a zero byte; `stepper` is NULL or points to a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ambid_load(path: *const c_char, stepper: *mut *mut AmbidStepper) -> AmbidStatus {
    guard(|| {
        if path.is_null() {
            return null("path");
        }
        // SAFETY: the caller's promise.
        let path = unsafe { CStr::from_ptr(path) }.to_str();
        let path = path.map_err(|_| (AmbidStatus::File, "path is not UTF-8".to_owned()))?;
        let bytes = read(Path::new(path)).map_err(|what| (AmbidStatus::File, what))?;
        // SAFETY: the caller's promise.
        unsafe { hand_over(&bytes, stepper) }
    })
}

/// The same from the bytes of such a file, which are not needed afterwards.
///
/// # Safety
/// `bytes` is NULL or points to `length` bytes; `stepper` is NULL or points to a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ambid_load_bytes(
    bytes: *const u8,
    length: usize,
    stepper: *mut *mut AmbidStepper,
) -> AmbidStatus {
    guard(|| {
        if bytes.is_null() {
            return null("bytes");
        }
        // SAFETY: the caller's promise.
        unsafe { hand_over(slice::from_raw_parts(bytes, length), stepper) }
    })
}

/// One sample: `y` becomes the outputs of this instant, `u` is held until the next. SI units.
///
/// Where it fails, the loop and `y` are as before.
///
/// # Safety
/// `stepper` is NULL or comes from `ambid_load`; `u` points to `inputs`, `y` to `outputs` numbers, which do not overlap.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ambid_step(
    stepper: *mut AmbidStepper,
    u: *const f64,
    inputs: usize,
    y: *mut f64,
    outputs: usize,
) -> AmbidStatus {
    guard(|| {
        // SAFETY: the caller's promise.
        let Some(own) = (unsafe { stepper.as_mut() }) else { return null("stepper") };
        if (u.is_null() && inputs > 0) || (y.is_null() && outputs > 0) {
            return null("u or y");
        }
        // SAFETY: the caller's promise; no numbers need no memory.
        let u = if inputs > 0 { unsafe { slice::from_raw_parts(u, inputs) } } else { &[] };
        let y = if outputs > 0 { unsafe { slice::from_raw_parts_mut(y, outputs) } } else { &mut [] };
        own.stepper.step(u, y).map_err(fault)
    })
}

/// Back to rest.
///
/// # Safety
/// `stepper` is NULL or comes from `ambid_load`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ambid_reset(stepper: *mut AmbidStepper) -> AmbidStatus {
    guard(|| {
        // SAFETY: the caller's promise.
        let Some(own) = (unsafe { stepper.as_mut() }) else { return null("stepper") };
        own.stepper.reset();
        Ok(())
    })
}

/// Gives the memory back. NULL is allowed.
///
/// # Safety
/// `stepper` is NULL or comes from `ambid_load`, and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ambid_free(stepper: *mut AmbidStepper) {
    if !stepper.is_null() {
        // SAFETY: the caller's promise.
        drop(unsafe { Box::from_raw(stepper) });
    }
}

/// Number of inputs; 0 of NULL.
///
/// # Safety
/// `stepper` is NULL or comes from `ambid_load`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ambid_inputs(stepper: *const AmbidStepper) -> usize {
    // SAFETY: the caller's promise.
    unsafe { stepper.as_ref() }.map_or(0, |own| own.inputs.len())
}

/// Number of outputs; 0 of NULL.
///
/// # Safety
/// `stepper` is NULL or comes from `ambid_load`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ambid_outputs(stepper: *const AmbidStepper) -> usize {
    // SAFETY: the caller's promise.
    unsafe { stepper.as_ref() }.map_or(0, |own| own.outputs.len())
}

/// Name of an input, such as `i_e.A_zeta`; it lives as long as the stepper. NULL where there is none.
///
/// # Safety
/// `stepper` is NULL or comes from `ambid_load`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ambid_input_name(stepper: *const AmbidStepper, index: usize) -> *const c_char {
    // SAFETY: the caller's promise.
    let name = unsafe { stepper.as_ref() }.and_then(|own| own.inputs.get(index));
    name.map_or(std::ptr::null(), |name| name.as_ptr())
}

/// Name of an output, such as `y.A_zeta`; it lives as long as the stepper. NULL where there is none.
///
/// # Safety
/// `stepper` is NULL or comes from `ambid_load`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ambid_output_name(stepper: *const AmbidStepper, index: usize) -> *const c_char {
    // SAFETY: the caller's promise.
    let name = unsafe { stepper.as_ref() }.and_then(|own| own.outputs.get(index));
    name.map_or(std::ptr::null(), |name| name.as_ptr())
}

/// Time from sample to sample in seconds; 0 of NULL.
///
/// # Safety
/// `stepper` is NULL or comes from `ambid_load`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ambid_sample_time(stepper: *const AmbidStepper) -> f64 {
    // SAFETY: the caller's promise.
    unsafe { stepper.as_ref() }.map_or(0.0, |own| own.sample_time)
}

/// What went wrong in the last call of this thread that did; it lives until the next one that does.
#[unsafe(no_mangle)]
pub extern "C" fn ambid_error() -> *const c_char {
    LAST_ERROR.with_borrow(|text| text.as_ptr())
}

/// A status and its words.
type Fault = (AmbidStatus, String);

/// Runs what may fail or panic, and keeps the words of it.
fn guard(work: impl FnOnce() -> Result<(), Fault>) -> AmbidStatus {
    let unexpected = || Err((AmbidStatus::Internal, "a mistake in the library; please report it".to_owned()));
    let Err((status, what)) = catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| unexpected()) else {
        return AmbidStatus::Ok;
    };
    LAST_ERROR.set(text(&what));
    status
}

fn null(what: &str) -> Result<(), Fault> {
    Err((AmbidStatus::Null, format!("{what} is NULL")))
}

fn fault(error: Error) -> Fault {
    let status = match error {
        Error::Shape { .. } => AmbidStatus::Size,
        Error::NotFinite { .. } => AmbidStatus::NotFinite,
        _ => AmbidStatus::Internal,
    };
    (status, error.to_string())
}

/// The content of a file, no more than a stepper may have.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    let found = File::open(path).and_then(|file| file.take(LARGEST_FILE + 1).read_to_end(&mut bytes));
    match found {
        Err(error) => Err(format!("{}: cannot be read ({error})", path.display())),
        Ok(count) if count as u64 > LARGEST_FILE => Err(format!("{}: larger than a stepper file", path.display())),
        Ok(_) => Ok(bytes),
    }
}

/// A text for C, which ends at a zero byte.
pub(crate) fn text(what: &str) -> CString {
    CString::new(what.replace('\0', "")).unwrap_or_default()
}

/// # Safety
/// `out` is NULL or points to a pointer.
unsafe fn hand_over(bytes: &[u8], out: *mut *mut AmbidStepper) -> Result<(), Fault> {
    // SAFETY: the caller's promise.
    let Some(out) = (unsafe { out.as_mut() }) else { return null("stepper") };
    *out = std::ptr::null_mut();
    let loaded = || -> ambid_core::Result<AmbidStepper> {
        let packed = Packed::from_bytes(bytes)?;
        let names = |of: &[String]| of.iter().map(|name| text(name)).collect();
        Ok(AmbidStepper {
            stepper: Stepper::new(&packed.system()?, &packed.theta)?,
            sample_time: packed.model.dt,
            inputs: names(&packed.inputs),
            outputs: names(&packed.outputs),
        })
    };
    let loaded = loaded().map_err(|error| (AmbidStatus::Format, error.to_string()))?;
    *out = Box::into_raw(Box::new(loaded));
    Ok(())
}
