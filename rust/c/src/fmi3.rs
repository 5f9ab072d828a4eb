//! FMI 3.0 for co-simulation: `fmi3Functions.h` of the Modelica Association's standard.

use std::ffi::{CStr, c_char, c_void};
use std::path::PathBuf;
use std::rc::Rc;

use crate::fmu::{ERROR, OK, free, instantiate, numbers, numbers_mut, with};
use crate::stepper::text;

type LogMessage = unsafe extern "C" fn(*mut c_void, i32, *const c_char, *const c_char);

#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetVersion() -> *const c_char {
    c"3.0".as_ptr()
}

/// # Safety
/// As the standard says; this holds for all that follow.
#[unsafe(no_mangle)]
#[allow(clippy::too_many_arguments)]
pub unsafe extern "C" fn fmi3InstantiateCoSimulation(
    _name: *const c_char,
    token: *const c_char,
    resources: *const c_char,
    _visible: bool,
    _logging: bool,
    _event_mode: bool,
    _early_return: bool,
    _intermediate: *const u32,
    _intermediate_count: usize,
    environment: *mut c_void,
    log_message: Option<LogMessage>,
    _intermediate_update: Option<unsafe extern "C" fn()>,
) -> *mut c_void {
    // SAFETY: texts of the importer are NULL or end with a zero byte.
    unsafe {
        let log = Rc::new(move |what: &str| {
            if let Some(log) = log_message {
                log(environment, ERROR, c"logStatusError".as_ptr(), text(what).as_ptr());
            }
        });
        let resources = if resources.is_null() { None } else { CStr::from_ptr(resources).to_str().ok() };
        instantiate(token, resources.map(PathBuf::from), log)
    }
}

/// # Safety
/// See [`fmi3InstantiateCoSimulation`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3FreeInstance(instance: *mut c_void) {
    // SAFETY: an instance of ours.
    unsafe { free(instance) }
}

/// # Safety
/// See [`fmi3InstantiateCoSimulation`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3EnterInitializationMode(
    instance: *mut c_void,
    _tolerance_defined: bool,
    _tolerance: f64,
    start: f64,
    _stop_defined: bool,
    _stop: f64,
) -> i32 {
    // SAFETY: an instance of ours.
    unsafe { with(instance, |own| own.start(start)) }
}

/// # Safety
/// See [`fmi3InstantiateCoSimulation`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3ExitInitializationMode(instance: *mut c_void) -> i32 {
    // SAFETY: an instance of ours.
    unsafe { with(instance, |own| own.begin()) }
}

/// # Safety
/// See [`fmi3InstantiateCoSimulation`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3Reset(instance: *mut c_void) -> i32 {
    // SAFETY: an instance of ours.
    unsafe { with(instance, |own| own.reset()) }
}

/// # Safety
/// See [`fmi3InstantiateCoSimulation`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetFloat64(
    instance: *mut c_void,
    references: *const u32,
    count: usize,
    values: *mut f64,
    value_count: usize,
) -> i32 {
    // SAFETY: an instance of ours, and as many numbers as are said.
    unsafe { with(instance, |own| own.get(numbers(references, count), numbers_mut(values, value_count))) }
}

/// # Safety
/// See [`fmi3InstantiateCoSimulation`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetFloat64(
    instance: *mut c_void,
    references: *const u32,
    count: usize,
    values: *const f64,
    value_count: usize,
) -> i32 {
    // SAFETY: an instance of ours, and as many numbers as are said.
    unsafe { with(instance, |own| own.set(numbers(references, count), numbers(values, value_count))) }
}

/// # Safety
/// See [`fmi3InstantiateCoSimulation`].
#[unsafe(no_mangle)]
#[allow(clippy::too_many_arguments)]
pub unsafe extern "C" fn fmi3DoStep(
    instance: *mut c_void,
    from: f64,
    length: f64,
    _no_set_prior: bool,
    event: *mut bool,
    terminate: *mut bool,
    early: *mut bool,
    last: *mut f64,
) -> i32 {
    // SAFETY: an instance of ours, and numbers that are NULL or may be written.
    unsafe {
        [event, terminate, early].into_iter().for_each(|flag| {
            if let Some(flag) = flag.as_mut() {
                *flag = false;
            }
        });
        let done = with(instance, |own| own.step(from, length));
        if let Some(last) = last.as_mut() {
            *last = if done == OK { from + length } else { from };
        }
        done
    }
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
    fmi3SetDebugLogging(bool, usize, *const *const c_char),
    fmi3EnterConfigurationMode(),
    fmi3ExitConfigurationMode(),
    fmi3Terminate(),
}

/// Variables of a type that the unit does not have: none of them is done, some are an error.
macro_rules! no_variables {
    ($($get:ident $set:ident($value:ty)),* $(,)?) => {$(
        #[unsafe(no_mangle)]
        pub extern "C" fn $get(instance: *mut c_void, _: *const u32, count: usize, _: *mut $value, _: usize) -> i32 {
            if instance.is_null() || count > 0 { ERROR } else { OK }
        }

        #[unsafe(no_mangle)]
        pub extern "C" fn $set(instance: *mut c_void, _: *const u32, count: usize, _: *const $value, _: usize) -> i32 {
            if instance.is_null() || count > 0 { ERROR } else { OK }
        }
    )*};
}

no_variables! {
    fmi3GetFloat32 fmi3SetFloat32(f32),
    fmi3GetInt8 fmi3SetInt8(i8), fmi3GetUInt8 fmi3SetUInt8(u8),
    fmi3GetInt16 fmi3SetInt16(i16), fmi3GetUInt16 fmi3SetUInt16(u16),
    fmi3GetInt32 fmi3SetInt32(i32), fmi3GetUInt32 fmi3SetUInt32(u32),
    fmi3GetInt64 fmi3SetInt64(i64), fmi3GetUInt64 fmi3SetUInt64(u64),
    fmi3GetBoolean fmi3SetBoolean(bool), fmi3GetString fmi3SetString(*const c_char),
}

/// What the description of the unit says that it cannot do.
macro_rules! not_supported {
    ($($name:ident($($argument:ty),*)),* $(,)?) => {$(
        #[unsafe(no_mangle)]
        #[allow(clippy::too_many_arguments)]
        pub extern "C" fn $name(_: *mut c_void $(, _: $argument)*) -> i32 {
            ERROR
        }
    )*};
}

not_supported! {
    fmi3GetBinary(*const u32, usize, *mut usize, *mut *const u8, usize),
    fmi3SetBinary(*const u32, usize, *const usize, *const *const u8, usize),
    fmi3GetClock(*const u32, usize, *mut bool),
    fmi3SetClock(*const u32, usize, *const bool),
    fmi3GetNumberOfVariableDependencies(u32, *mut usize),
    fmi3GetVariableDependencies(u32, *mut usize, *mut u32, *mut usize, *mut i32, usize),
    fmi3GetFMUState(*mut *mut c_void),
    fmi3SetFMUState(*mut c_void),
    fmi3FreeFMUState(*mut *mut c_void),
    fmi3SerializedFMUStateSize(*mut c_void, *mut usize),
    fmi3SerializeFMUState(*mut c_void, *mut u8, usize),
    fmi3DeserializeFMUState(*const u8, usize, *mut *mut c_void),
    fmi3GetDirectionalDerivative(*const u32, usize, *const u32, usize, *const f64, usize, *mut f64, usize),
    fmi3GetAdjointDerivative(*const u32, usize, *const u32, usize, *const f64, usize, *mut f64, usize),
    fmi3GetOutputDerivatives(*const u32, usize, *const i32, *mut f64, usize),
    fmi3EnterEventMode(),
    fmi3EnterStepMode(),
    fmi3GetIntervalDecimal(*const u32, usize, *mut f64, *mut i32),
    fmi3GetIntervalFraction(*const u32, usize, *mut u64, *mut u64, *mut i32),
    fmi3GetShiftDecimal(*const u32, usize, *mut f64),
    fmi3GetShiftFraction(*const u32, usize, *mut u64, *mut u64),
    fmi3SetIntervalDecimal(*const u32, usize, *const f64),
    fmi3SetIntervalFraction(*const u32, usize, *const u64, *const u64),
    fmi3SetShiftDecimal(*const u32, usize, *const f64),
    fmi3SetShiftFraction(*const u32, usize, *const u64, *const u64),
    fmi3EvaluateDiscreteStates(),
    fmi3UpdateDiscreteStates(*mut bool, *mut bool, *mut bool, *mut bool, *mut bool, *mut f64),
    fmi3EnterContinuousTimeMode(),
    fmi3CompletedIntegratorStep(bool, *mut bool, *mut bool),
    fmi3SetTime(f64),
    fmi3SetContinuousStates(*const f64, usize),
    fmi3GetContinuousStateDerivatives(*mut f64, usize),
    fmi3GetEventIndicators(*mut f64, usize),
    fmi3GetContinuousStates(*mut f64, usize),
    fmi3GetNominalsOfContinuousStates(*mut f64, usize),
    fmi3GetNumberOfEventIndicators(*mut usize),
    fmi3GetNumberOfContinuousStates(*mut usize),
    fmi3ActivateModelPartition(u32, f64),
}

/// Model exchange, which the unit is not for.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3InstantiateModelExchange() -> *mut c_void {
    std::ptr::null_mut()
}

/// Scheduled execution, which the unit is not for.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3InstantiateScheduledExecution() -> *mut c_void {
    std::ptr::null_mut()
}
