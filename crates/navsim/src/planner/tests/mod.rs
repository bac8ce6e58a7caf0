//! Tests of the planners: `maps` and `grids` against brute force, `plans` by an independent check of every path,
//! `trees` and `lookahead`.

mod grids;
mod lookahead;
mod maps;
mod plans;
mod trees;
