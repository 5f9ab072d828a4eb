//! FMI 2.0 for co-simulation: `fmi2Functions.h` of the Modelica Association's standard.

use std::ffi::{CStr, CString, c_char, c_void};
use std::path::PathBuf;
use std::rc::Rc;

use crate::fmu::{ERROR, OK, free, instantiate, numbers, numbers_mut, with};
use crate::stepper::text;

type Logger = unsafe extern "C" fn(*mut c_void, *const c_char, i32, *const c_char, *const c_char, ...);

/// `fmi2CallbackFunctions`.
#[repr(C)]
pub struct Callbacks {
    logger: Option<Logger>,
    allocate_memory: Option<unsafe extern "C" fn()>,
    free_memory: Option<unsafe extern "C" fn()>,
    step_finished: Option<unsafe extern "C" fn()>,
    environment: *mut c_void,
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetTypesPlatform() -> *const c_char {
    c"default".as_ptr()
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetVersion() -> *const c_char {
    c"2.0".as_ptr()
}

/// # Safety
/// As the standard says; this holds for all that follow.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2Instantiate(
    name: *const c_char,
    kind: i32,
    token: *const c_char,
    resources: *const c_char,
    callbacks: *const Callbacks,
    _visible: i32,
    _logging: i32,
) -> *mut c_void {
    const CO_SIMULATION: i32 = 1;
    // SAFETY: texts of the importer are NULL or end with a zero byte, and its callbacks live as long as the instance.
    unsafe {
        let name = if name.is_null() { CString::default() } else { CStr::from_ptr(name).to_owned() };
        let callbacks = callbacks.as_ref().and_then(|own| Some((own.logger?, own.environment)));
        let log = Rc::new(move |what: &str| {
            if let Some((logger, environment)) = callbacks {
                // the message is a format
                let message = text(&what.replace('%', "%%"));
                logger(environment, name.as_ptr(), ERROR, c"logStatusError".as_ptr(), message.as_ptr());
            }
        });
        if kind != CO_SIMULATION {
            log("the unit is for co-simulation");
            return std::ptr::null_mut();
        }
        let resources = if resources.is_null() { None } else { CStr::from_ptr(resources).to_str().ok() };
        instantiate(token, resources.and_then(local), log)
    }
}

/// The path of a file URI, such as `file:///tmp/unit/resources`.
fn local(uri: &str) -> Option<PathBuf> {
    let rest = uri.strip_prefix("file:")?;
    let path = rest.strip_prefix("//").map_or(rest, |rest| rest.strip_prefix("localhost").unwrap_or(rest));
    let mut bytes = Vec::new();
    let mut rest = path.as_bytes();
    while let [first, tail @ ..] = rest {
        let code = tail.get(..2).filter(|_| *first == b'%').and_then(|code| std::str::from_utf8(code).ok());
        match code.and_then(|code| u8::from_str_radix(code, 16).ok()) {
            Some(byte) => (bytes.push(byte), rest = &tail[2..]).1,
            None => (bytes.push(*first), rest = tail).1,
        }
    }
    let path = String::from_utf8(bytes).ok()?;
    // on Windows /C:/unit is C:/unit
    let drive = cfg!(windows) && path.as_bytes().get(2) == Some(&b':');
    Some(PathBuf::from(if drive { &path[1..] } else { &path }))
}

/// # Safety
/// See [`fmi2Instantiate`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2FreeInstance(instance: *mut c_void) {
    // SAFETY: an instance of ours.
    unsafe { free(instance) }
}

/// # Safety
/// See [`fmi2Instantiate`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetupExperiment(
    instance: *mut c_void,
    _tolerance_defined: i32,
    _tolerance: f64,
    start: f64,
    _stop_defined: i32,
    _stop: f64,
) -> i32 {
    // SAFETY: an instance of ours.
    unsafe { with(instance, |own| own.start(start)) }
}

/// # Safety
/// See [`fmi2Instantiate`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2ExitInitializationMode(instance: *mut c_void) -> i32 {
    // SAFETY: an instance of ours.
    unsafe { with(instance, |own| own.begin()) }
}

/// # Safety
/// See [`fmi2Instantiate`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2Reset(instance: *mut c_void) -> i32 {
    // SAFETY: an instance of ours.
    unsafe { with(instance, |own| own.reset()) }
}

/// # Safety
/// See [`fmi2Instantiate`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetReal(
    instance: *mut c_void,
    references: *const u32,
    count: usize,
    values: *mut f64,
) -> i32 {
    // SAFETY: an instance of ours, and as many numbers as are said.
    unsafe { with(instance, |own| own.get(numbers(references, count), numbers_mut(values, count))) }
}

/// # Safety
/// See [`fmi2Instantiate`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetReal(
    instance: *mut c_void,
    references: *const u32,
    count: usize,
    values: *const f64,
) -> i32 {
    // SAFETY: an instance of ours, and as many numbers as are said.
    unsafe { with(instance, |own| own.set(numbers(references, count), numbers(values, count))) }
}

/// # Safety
/// See [`fmi2Instantiate`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2DoStep(instance: *mut c_void, from: f64, length: f64, _no_set_prior: i32) -> i32 {
    // SAFETY: an instance of ours.
    unsafe { with(instance, |own| own.step(from, length)) }
}

/// What has nothing to do.
macro_rules! nothing_to_do {
    ($($name:ident($($argument:ty),*)),* $(,)?) => {$(
        #[unsafe(no_mangle)]
        pub extern "C" fn $name(instance: *mut c_void $(, _: $argument)*) -> i32 {
            if instance.is_null() { ERROR } else { OK }
        }
    )*};
}

nothing_to_do! {
    fmi2SetDebugLogging(i32, usize, *const *const c_char),
    fmi2EnterInitializationMode(),
    fmi2Terminate(),
}

/// Variables of a type that the unit does not have: none of them is done, some are an error.
macro_rules! no_variables {
    ($($name:ident($value:ty)),* $(,)?) => {$(
        #[unsafe(no_mangle)]
        pub extern "C" fn $name(instance: *mut c_void, _: *const u32, count: usize, _: $value) -> i32 {
            if instance.is_null() || count > 0 { ERROR } else { OK }
        }
    )*};
}

no_variables! {
    fmi2GetInteger(*mut i32), fmi2SetInteger(*const i32),
    fmi2GetBoolean(*mut i32), fmi2SetBoolean(*const i32),
    fmi2GetString(*mut *const c_char), fmi2SetString(*const *const c_char),
}

/// What the description of the unit says that it cannot do.
macro_rules! not_supported {
    ($($name:ident($($argument:ty),*)),* $(,)?) => {$(
        #[unsafe(no_mangle)]
        pub extern "C" fn $name(_: *mut c_void $(, _: $argument)*) -> i32 {
            ERROR
        }
    )*};
}

not_supported! {
    fmi2GetFMUstate(*mut *mut c_void),
    fmi2SetFMUstate(*mut c_void),
    fmi2FreeFMUstate(*mut *mut c_void),
    fmi2SerializedFMUstateSize(*mut c_void, *mut usize),
    fmi2SerializeFMUstate(*mut c_void, *mut c_char, usize),
    fmi2DeSerializeFMUstate(*const c_char, usize, *mut *mut c_void),
    fmi2GetDirectionalDerivative(*const u32, usize, *const u32, usize, *const f64, *mut f64),
    fmi2SetRealInputDerivatives(*const u32, usize, *const i32, *const f64),
    fmi2GetRealOutputDerivatives(*const u32, usize, *const i32, *mut f64),
    fmi2CancelStep(),
    fmi2GetStatus(i32, *mut i32),
    fmi2GetRealStatus(i32, *mut f64),
    fmi2GetIntegerStatus(i32, *mut i32),
    fmi2GetBooleanStatus(i32, *mut i32),
    fmi2GetStringStatus(i32, *mut *const c_char),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uris_become_paths() {
        for (uri, path) in [
            ("file:///tmp/a%20unit/resources", Some("/tmp/a unit/resources")),
            ("file:/tmp/100%/x", Some("/tmp/100%/x")),
            ("file://localhost/tmp", Some("/tmp")),
            ("http://tmp", None),
        ] {
            assert_eq!(local(uri), path.map(PathBuf::from), "{uri}");
        }
    }
}
