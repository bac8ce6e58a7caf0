//! The actor asked about many observations at once.

use crate::aligned::Aligned;
use crate::batch::{ACTIONS, Mirror};
use crate::error::{Result, expect, expect_size};
use crate::kernels::Isa;
use crate::layer::Layer;
use crate::network::Actor;
use crate::packed::Packed;
use crate::real::Real;
use crate::settings::check_layers;

/// Observations that pass the network together; as this never changes, neither do the bits of one beside others.
const ROWS: usize = 64;

/// Memory to act with.
#[derive(Debug, Clone)]
pub struct Acting<T> {
    actor: Actor<T>,
    /// (inputs, ROWS).
    observations: Aligned<T>,
    /// The mirror of an observation, if answers are symmetric; the same observations, mirrored;
    /// and the outputs for them.
    mirror: Option<(Mirror, Aligned<T>, Vec<T>)>,
    /// Numbers in the actor's packed vector.
    size: usize,
}

impl<T: Real> Acting<T> {
    /// Memory for an actor with these layers, hidden ones and the output, in its packed vector of `size` numbers. With
    /// the mirror of an observation its answers are symmetric: tanh of half the sum of its outputs for an observation
    /// and, mirrored back, for the mirrored one.
    ///
    /// # Errors
    /// Layers that do not follow each other or lie beyond the vector, a mirror of other columns.
    pub fn new(layers: &[Layer], size: usize, mirror: Option<Mirror>, isa: Isa) -> Result<Self> {
        expect("layers of the actor", layers.len(), layers.len() >= 2, || "at least 2".into())?;
        check_layers("actor", layers, size, 1, ACTIONS)?;
        let observations = || Aligned::zeros(layers[0].inputs * ROWS);
        mirror.iter().try_for_each(|mirror| mirror.check(layers[0].inputs))?;
        let mirror = mirror.map(|mirror| (mirror, observations(), vec![T::ZERO; ACTIONS * ROWS]));
        Ok(Self { actor: Actor::new(layers, [ROWS; 2], isa), observations: observations(), mirror, size })
    }

    /// Numbers in an observation.
    pub fn inputs(&self) -> usize {
        self.observations.len() / ROWS
    }

    /// Sets `actions` (n, 2) to tanh of the actor's outputs for `observations` (n, inputs), both by rows.
    ///
    /// # Errors
    /// A slice has another length than the settings imply.
    pub fn act(&mut self, parameters: &[T], observations: &[f32], actions: &mut [f32]) -> Result<()> {
        let inputs = self.inputs();
        let count = observations.len();
        expect_size("the actor's parameters", parameters.len(), self.size)?;
        expect("numbers in observations", count, count.is_multiple_of(inputs), || format!("a multiple of {inputs}"))?;
        expect_size("actions", actions.len(), count / inputs * ACTIONS)?;
        for (rows, actions) in observations.chunks(ROWS * inputs).zip(actions.chunks_mut(ROWS * ACTIONS)) {
            for (place, row) in rows.chunks_exact(inputs).enumerate() {
                for (number, &x) in self.observations[place..].iter_mut().step_by(ROWS).zip(row) {
                    *number = T::of(f64::from(x));
                }
            }
            self.forward(Packed::new(&[(0, parameters)]));
            let (forward, turn) = self.actor.outputs.split_at(ROWS);
            for (action, (v, omega)) in actions.chunks_exact_mut(ACTIONS).zip(forward.iter().zip(turn)) {
                // Eq. 8: mu(s) = tanh of the output layer
                action.copy_from_slice(&[v, omega].map(|z| z.tanh().wide() as f32));
            }
        }
        Ok(())
    }

    /// Sets the actor's outputs for the present observations.
    fn forward(&mut self, parameters: Packed<'_, T>) {
        let Self { actor, observations, mirror, .. } = self;
        let Some((mirror, mirrored, others)) = mirror else {
            return actor.forward(parameters, observations);
        };
        for ((row, &from), &sign) in mirrored.chunks_exact_mut(ROWS).zip(&mirror.permutation).zip(&mirror.signs) {
            for (number, &x) in row.iter_mut().zip(&observations[from * ROWS..]) {
                *number = T::of(f64::from(sign)) * x;
            }
        }
        actor.forward(parameters, mirrored);
        others.copy_from_slice(&actor.outputs);
        actor.forward(parameters, observations);
        // A mirrored action turns the other way.
        let signs = [T::ONE, -T::ONE];
        let rows = actor.outputs.chunks_exact_mut(ROWS).zip(others.chunks_exact(ROWS));
        for ((outputs, others), sign) in rows.zip(signs) {
            for (z, &other) in outputs.iter_mut().zip(others) {
                *z = (*z + sign * other) * T::of(0.5);
            }
        }
    }
}
