//! The stepper for programs in C (`include/ambid.h`), and as a functional mock-up unit (FMI 2.0 and 3.0).
//!
//! No panic crosses the boundary: it becomes a status. Nothing is allocated in a step that succeeds.

mod fmi2;
mod fmi3;
mod fmu;
mod stepper;

pub use stepper::*;
