//! The promise that a step allocates nothing, counted by this process's allocator.
#![allow(clippy::unwrap_used)]

use navsim::{BatchSim, SimConfig};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicU64, Ordering};

/// The system's allocator, counting what it hands out.
struct Counting;

static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);

// SAFETY: every call is passed on unchanged to the system's allocator; `realloc` and `alloc_zeroed` go through `alloc`.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// Allocations of 1,000 steps with all resets that fall due, once 1,000 steps have made all memory that they need.
fn allocations(world: &str, noise: f64, num_envs: usize, threads: usize) -> u64 {
    let mut config = SimConfig::from_json(include_str!("defaults.json")).unwrap();
    config.world.name = world.into();
    (config.lidar.noise, config.lidar.drop_probability) = (noise, noise);
    let mut sim = BatchSim::new(config, num_envs, 0, threads, true, None).unwrap();
    let actions: Vec<f32> = (0..2 * num_envs).map(|i| libm::sin(i as f64) as f32).collect();
    let mut run = || (0..1_000).for_each(|_| sim.step(&actions).unwrap());
    run();
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    run();
    let count = ALLOCATIONS.load(Ordering::Relaxed) - before;
    assert!(sim.results().episodes.iter().sum::<u64>() > 10, "no resets");
    count
}

/// One test, so that no other thread of this process allocates meanwhile.
#[test]
fn a_step_allocates_nothing() {
    for world in ["td3", "boxes", "open8"] {
        for noise in [0.0, 0.01] {
            assert_eq!(allocations(world, noise, 32, 1), 0, "{world}, noise {noise}");
        }
    }
    // Handing a part over to another thread takes a job's few bytes (and now and then a block of rayon's queue),
    // however many robots there are.
    for num_envs in [32, 256] {
        let count = allocations("open8", 0.0, num_envs, 3);
        assert!(count <= 1_000 * 2 * 11 / 10, "{num_envs} robots on 3 threads: {count} allocations in 1,000 steps");
    }
}
