//! Tests of shortest paths: `analytic` with lengths known by hand, `random` against a search of another kind.

mod analytic;
pub(crate) mod random;
