//! Which world each robot drives in.

use super::generator::{Generator, Layout};
use crate::config::WorldConfig;
use crate::error::Result;
use crate::robot::Footprint;

/// The world `mixed`: names and numbers of boxes (for `boxes`).
const MIXED: [(&str, usize); 8] =
    [("td3", 0), ("boxes", 4), ("open8", 0), ("boxes", 8), ("td3", 0), ("boxes", 12), ("walls", 0), ("boxes", 16)];

/// The worlds of a configuration, one or several: robot k, and scenario k of a list, has world k modulo their number.
#[derive(Debug, Clone)]
pub struct Worlds {
    generators: Vec<Generator>,
}

impl Worlds {
    /// Prepares the world `config.name`, or all that `mixed` consists of, for a robot of this `footprint`.
    ///
    /// # Errors
    /// Those of [`Generator::new`].
    pub fn new(config: &WorldConfig, footprint: &Footprint) -> Result<Self> {
        let generators = if config.name == "mixed" {
            let part = |&(name, boxes): &(&str, usize)| WorldConfig { name: name.into(), boxes, ..config.clone() };
            MIXED.iter().map(|world| Generator::new(&part(world), footprint)).collect::<Result<_>>()?
        } else {
            vec![Generator::new(config, footprint)?]
        };
        Ok(Self { generators })
    }

    /// The world of a robot or scenario.
    pub fn of(&self, index: usize) -> &Generator {
        &self.generators[index % self.generators.len()]
    }

    /// Memory for draws in each world, in which that of a robot is found as its world is.
    pub fn layouts(&self) -> Vec<Layout> {
        self.generators.iter().map(Generator::layout).collect()
    }

    /// Share of the free area in which no start or goal is drawn, in the world where it is largest; in [0, 1].
    pub fn cut_off(&self) -> f64 {
        self.generators.iter().map(Generator::cut_off).fold(0.0, f64::max)
    }
}
