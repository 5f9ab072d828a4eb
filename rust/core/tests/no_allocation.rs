//! Once built, a stepper never asks for memory.

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::hint::black_box;

use ambid_core::Stepper;
use common::loops::lags;
use common::machine::{machine, saturating};

/// The system's allocator, counting.
struct Counting;

thread_local! {
    /// Of this thread alone: whoever runs the tests asks for memory at any time.
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: all calls go to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = ALLOCATIONS.try_with(|n| n.set(n.get() + 1));
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn steps_and_resets_never_allocate() {
    let digital = lags(&[0.7, 0.7], &[&[], &[0]], &[1]).under_digital(0.1, 0.3, 2.5);
    for p in [machine(0.0, 0.02), machine(100.0, 0.02), digital, saturating(0.0, 4, None)] {
        let mut stepper = Stepper::new(&p.system(), &p.theta).expect("regular");
        let (u, mut y) = (vec![1.0; stepper.inputs()], vec![0.0; stepper.outputs()]);
        let before = ALLOCATIONS.get();
        for _ in 0..3 {
            for _ in 0..1000 {
                stepper.step(black_box(&u), &mut y).expect("sizes fit");
                stepper.outputs_now(black_box(&u), &mut y).expect("sizes fit");
            }
            stepper.reset();
        }
        assert_eq!(ALLOCATIONS.get() - before, 0);
        assert!(before > 0, "the counter counts");
    }
}
