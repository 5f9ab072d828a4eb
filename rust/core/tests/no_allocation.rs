//! Once built, a stepper never asks for memory. Alone in its binary, so that nobody else does meanwhile.

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::hint::black_box;
use std::sync::atomic::{AtomicUsize, Ordering};

use ambid_core::Stepper;
use common::loops::lags;
use common::machine::{machine, saturating};

/// The system's allocator, counting.
struct Counting;

static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: all calls go to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::SeqCst);
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
        let before = ALLOCATIONS.load(Ordering::SeqCst);
        for _ in 0..3 {
            for _ in 0..1000 {
                stepper.step(black_box(&u), &mut y).expect("sizes fit");
                stepper.outputs_now(black_box(&u), &mut y).expect("sizes fit");
            }
            stepper.reset();
        }
        assert_eq!(ALLOCATIONS.load(Ordering::SeqCst) - before, 0);
        assert!(before > 0, "the counter counts");
    }
}
