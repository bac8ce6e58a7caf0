//! Benchmarks of the hot loop; see `benches/`.
