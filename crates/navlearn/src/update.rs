//! The update of TD3, with DDPG as its one-critic case (equations 9 and 10).

use crate::adam::Vectors;
use crate::batch::{ACTIONS, width};
use crate::call::{Call, Memory};
use crate::error::{Error, Result, expect, expect_size};
use crate::helper::Helper;
use crate::kernels::product::in_order;
use crate::kernels::{Isa, all_finite, rows_finite};
use crate::layer::Layer;
use crate::packed::{self, Shares};
use crate::real::Real;
use crate::settings::Settings;
use crate::team::{Patience, Team};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A network and its target, which updates change.
#[derive(Debug)]
pub struct Trained<'a, T> {
    /// The packed vectors.
    pub vectors: Vectors<'a, T>,
    /// Adam's step size.
    pub rate: f64,
    /// Adam's steps so far.
    pub steps: u64,
}

/// What the updates of one call draw: rows of replay, and noise on the target's actions.
#[derive(Debug, Clone, Copy)]
pub struct Draws<'a> {
    /// (rows, width) replay.
    pub replay: &'a [f32],
    /// Columns of replay.
    pub width: usize,
    /// (updates, batch) places in replay.
    pub indices: &'a [i64],
    /// (updates, batch) which rows are mirrored.
    pub mirrored: &'a [bool],
    /// (updates, batch, 2) clip(N(0, policy_noise), +-noise_clip).
    pub noise: &'a [f32],
}

impl Draws<'_> {
    /// Those of one update with `batch` rows.
    pub(crate) fn of_update(self, update: usize, batch: usize) -> Self {
        let rows = update * batch..(update + 1) * batch;
        Self {
            indices: &self.indices[rows.clone()],
            mirrored: &self.mirrored[rows.clone()],
            noise: &self.noise[ACTIONS * rows.start..ACTIONS * rows.end],
            ..self
        }
    }
}

/// What one update tells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Record {
    /// Mean squared error of the critics' values, summed over the critics.
    pub critic_loss: f64,
    /// Mean value over batch and critics.
    pub average_q: f64,
    /// Largest value.
    pub maximum_q: f64,
    /// The actor's loss and the share of its outputs that are saturated, if it stepped.
    pub actor: Option<[f64; 2]>,
}

/// What some updates tell.
#[derive(Debug, Clone, PartialEq)]
pub struct Updates {
    /// One for each.
    pub records: Vec<Record>,
    /// Whether two threads have waited so long for each other that the next updates are made by one.
    pub busy: bool,
}

/// Makes updates: sizes, settings and memory of one batch.
#[derive(Debug)]
pub struct Learner<T> {
    settings: Settings,
    isa: Isa,
    /// What each of two threads steps of the packed vectors of actor and critics.
    shares: [Shares; 2],
    memory: Memory<T>,
    helper: Option<Arc<Helper>>,
    patience: Patience,
}

impl<T: Real> Learner<T> {
    /// Takes memory for one batch, and starts a second thread where there are to be two and both halves have rows.
    ///
    /// # Errors
    /// Those of [`Settings::check`]; other than 1 or 2 threads, or a thread that does not start.
    pub fn new(settings: Settings, threads: usize, isa: Isa) -> Result<Self> {
        settings.check()?;
        expect("threads", threads, (1..=2).contains(&threads), || "1 or 2".into())?;
        let (batch, cut) = (settings.batch, settings.cut());
        let two = threads == 2 && cut < batch;
        let first = if two { cut } else { batch };
        let parts = [0..first, first..batch];
        let parts = if two { &parts[..] } else { &parts[..1] };
        Ok(Self {
            isa,
            shares: shares(&settings, two && in_order(isa)),
            memory: Memory::new(&settings, parts, isa),
            helper: two.then(Helper::new).transpose()?.map(Arc::new),
            patience: Patience::default(),
            settings,
        })
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The second thread, if there is one.
    pub fn helper(&self) -> Option<Arc<Helper>> {
        self.helper.clone()
    }

    /// Makes one update for each row of `draws.indices`; a second thread helps from the time when it has room.
    ///
    /// # Errors
    /// A number is not finite, a slice has another length than the settings imply, a row to mirror has no mirror, or an
    /// index is beyond replay; see [`Error`] for what has changed then.
    pub fn update(&mut self, actor: Trained<'_, T>, critics: Trained<'_, T>, draws: Draws<'_>) -> Result<Updates> {
        self.check(&actor, &critics, draws)?;
        let Self { settings, isa, shares, memory, helper, patience } = self;
        let count = draws.indices.len() / settings.batch;
        let call = Call::new(settings, *isa, draws, [actor, critics], shares, memory);
        let Some(helper) = helper.as_ref().filter(|helper| !patience.exhausted() && helper.exists()) else {
            let alone = |_, work: &dyn Fn(usize)| [0, 1].into_iter().for_each(work);
            let records = (0..count).map(|update| call.lead(update, alone)).collect::<Result<_>>()?;
            patience.note(count as u64, Duration::ZERO, Duration::ZERO);
            return Ok(Updates { records, busy: patience.exhausted() });
        };
        let (team, mut waited, mut begun) = (Team::default(), Duration::ZERO, None);
        let (records, ended) = helper.beside(|start| {
            let _end = team.until_dropped();
            let one_update = |update| {
                call.lead(update, |phase, work| {
                    if begun.is_none() && helper.has_room() {
                        begun = Some((update, Instant::now()));
                        start.work(|| team.help(|phase| call.help(phase)));
                    }
                    waited += team.lead(phase, work);
                })
            };
            let records: Result<_> = (0..count).map(one_update).collect();
            (records, Instant::now())
        });
        let records = records?;
        // The helper's thread has to come and go, even if the machine let it run so late that nothing was left to do.
        waited += ended.elapsed();
        if let Some((first, start)) = begun {
            patience.note((count - first) as u64, start.elapsed(), waited);
        }
        Ok(Updates { records, busy: patience.exhausted() })
    }

    /// Refuses sizes that do not fit, and names the first number that is not finite.
    fn check(&self, actor: &Trained<'_, T>, critics: &Trained<'_, T>, draws: Draws<'_>) -> Result<()> {
        let (batch, width, count) = (self.settings.batch, width(self.settings.inputs()), draws.indices.len());
        for (network, trained, size) in
            [("actor", actor, self.settings.sizes[0]), ("critic", critics, self.settings.sizes[1])]
        {
            let rate = trained.rate;
            expect(format!("the {network}'s rate"), rate, rate >= 0.0 && rate.is_finite(), || "at least 0".into())?;
            for (vector, numbers) in trained.vectors.named() {
                expect_size(format!("the {network}'s {vector}"), numbers.len(), size)?;
                if !all_finite(self.isa, numbers) {
                    let place = numbers.iter().position(|x| !x.finite()).unwrap_or_default();
                    return Err(Error::Parameter { network, vector, place });
                }
            }
        }
        expect_size("columns of replay", draws.width, width)?;
        expect("indices", count, count.is_multiple_of(batch), || format!("a multiple of {batch}"))?;
        expect_size("mirrored", draws.mirrored.len(), count)?;
        expect_size("noise", draws.noise.len(), ACTIONS * count)?;
        let flips = draws.mirrored.iter().filter(|&&flip| flip).count();
        expect("rows to mirror", flips, flips == 0 || self.settings.mirror.is_some(), || "0 without a mirror".into())?;
        if let Some(place) = draws.noise.iter().position(|noise| !noise.is_finite()) {
            return Err(Error::Noise { place });
        }
        let rows = draws.replay.len() / width;
        let (lowest, highest) = draws.indices.iter().fold((0, 0), |(low, high), &i| (low.min(i), high.max(i)));
        expect("an index", lowest, lowest >= 0, || "at least 0".into())?;
        expect("an index", highest, (highest as usize) < rows, || format!("less than {rows}"))?;
        if rows_finite(self.isa, draws.replay, width, draws.indices) {
            return Ok(());
        }
        let columns = |&index: &i64| draws.replay[index as usize * width..][..width].iter();
        let bad = |index| columns(index).position(|x| !x.is_finite()).map(|column| (*index as usize, column));
        let (row, column) = draws.indices.iter().find_map(bad).unwrap_or_default();
        Err(Error::Row { row, column })
    }
}

/// What each of two threads steps: of two critics one; of one network half, if it may be `cut` within a weight.
fn shares(settings: &Settings, cut: bool) -> [Shares; 2] {
    let shares = |layers: &[Layer], size| {
        if cut { packed::halves(&layers[..layers.len() - 1], size) } else { packed::shares(size, size) }
    };
    let critics =
        if settings.critics == 2 { settings.shares_by_critic() } else { shares(&settings.critic, settings.sizes[1]) };
    [shares(&settings.actor, settings.sizes[0]), critics]
}

impl<T> Vectors<'_, T> {
    fn named(&self) -> [(&'static str, &[T]); 4] {
        [
            ("parameters", self.parameters),
            ("targets", self.targets),
            ("first moments", self.first),
            ("second moments", self.second),
        ]
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const INPUTS: usize = 5;
    const ROWS: usize = 50;
    const ISAS: [Isa; 3] = [Isa::Baseline, Isa::Avx2, Isa::Avx512];

    fn numbers(count: usize, seed: f64) -> Vec<f32> {
        (0..count).map(|i| (seed + 2.3 * i as f64).sin() as f32 * 0.5).collect()
    }

    /// Layers one after the other, each with its weights and biases of `count` networks.
    fn layers(units: &[usize], count: usize, end: &mut usize) -> Vec<Layer> {
        let mut place = |size: usize| {
            *end += count * size;
            *end - count * size
        };
        let pairs = units.windows(2).map(|pair| (pair[0], pair[1]));
        pairs
            .map(|(inputs, outputs)| Layer { inputs, outputs, weight: place(inputs * outputs), bias: place(outputs) })
            .collect()
    }

    fn settings(batch: usize, critics: usize) -> Settings {
        let (mut actor_end, mut critic_end) = (0, critics * ACTIONS * 18);
        Settings {
            actor: layers(&[INPUTS, 21, 18, ACTIONS], 1, &mut actor_end),
            critic: layers(&[INPUTS, 21, 18, 1], critics, &mut critic_end),
            action_weight: 0,
            critics,
            batch,
            sizes: [actor_end, critic_end],
            policy_delay: 2,
            tau: 0.1,
            pretanh_penalty: 0.01,
            bounds: [-3.0, 3.0],
            frozen_combined: false,
            mirror: None,
        }
    }

    /// What `made` makes of networks in `count` updates of a learner with so many threads.
    fn state(
        settings: &Settings,
        isa: Isa,
        count: usize,
        threads: usize,
        made: impl FnOnce(&mut Learner<f32>, [Trained<'_, f32>; 2], Draws<'_>) -> Vec<Record>,
    ) -> (Vec<Vec<f32>>, Vec<Record>) {
        let mut learner = Learner::new(settings.clone(), threads, isa).unwrap();
        let vectors = |size, seed| [numbers(size, seed), numbers(size, seed + 0.1), vec![0.0; size], vec![0.0; size]];
        let mut networks = [vectors(settings.sizes[0], 0.1), vectors(settings.sizes[1], 0.7)];
        let trained = networks.each_mut().map(|[parameters, targets, first, second]| Trained {
            vectors: Vectors { parameters, targets, first, second },
            rate: 1e-2,
            steps: 0,
        });
        let width = width(INPUTS);
        let (replay, noise) = (numbers(ROWS * width, 0.3), numbers(count * settings.batch * ACTIONS, 0.9));
        let indices: Vec<i64> = (0..count * settings.batch).map(|i| (i * 17 % ROWS) as i64).collect();
        let mirrored = vec![false; indices.len()];
        let draws = Draws { replay: &replay, width, indices: &indices, mirrored: &mirrored, noise: &noise };
        let records = made(&mut learner, trained, draws);
        (networks.concat(), records)
    }

    /// Every update as a whole; and in halves, which a leader alone, two threads, or a helper that comes late goes
    /// through.
    #[test]
    fn halves_give_the_bits_of_the_whole() {
        const COUNT: usize = 30;
        let cases = [(96, 2), (45, 2), (9, 1), (40, 1)];
        for ((batch, critics), isa) in cases.iter().flat_map(|case| ISAS.map(|isa| (*case, isa))) {
            let (settings, case) = (settings(batch, critics), format!("batch {batch}, {critics} critics, {isa:?}"));
            let with_threads = |threads| {
                state(&settings, isa, COUNT, threads, |learner, [actor, critics], draws| {
                    learner.update(actor, critics, draws).unwrap().records
                })
            };
            let whole = with_threads(1);
            assert!(with_threads(2) == whole, "{case}");
            let apart = state(&settings, isa, COUNT, 2, |learner, networks, draws| {
                let Learner { settings, isa, shares, memory, .. } = learner;
                let call = &Call::new(settings, *isa, draws, networks, shares, memory);
                let both = |phase: usize, work: &dyn Fn(usize)| {
                    work(0);
                    std::thread::scope(|scope| scope.spawn(|| call.help(phase)).join()).unwrap();
                };
                (0..COUNT).map(|update| call.lead(update, both).unwrap()).collect()
            });
            assert!(apart == whole, "{case}, each second half in another thread");
            for phase in [1, 6, usize::MAX] {
                let late = state(&settings, isa, COUNT, 2, |learner, networks, draws| {
                    let Learner { settings, isa, shares, memory, .. } = learner;
                    let call = Call::new(settings, *isa, draws, networks, shares, memory);
                    let (team, call) = (Team::default(), &call);
                    std::thread::scope(|scope| {
                        let _end = team.until_dropped();
                        let team = &team;
                        let both = |now: usize, work: &dyn Fn(usize)| {
                            if now == phase {
                                scope.spawn(|| team.help(|phase| call.help(phase)));
                            }
                            team.lead(now, work);
                        };
                        (0..COUNT).map(|update| call.lead(update, both).unwrap()).collect()
                    })
                });
                assert!(late == whole, "{case}, a helper from phase {phase} on");
            }
        }
    }

    #[test]
    fn a_helper_whose_thread_comes_late_counts_as_waited_for() {
        let settings = settings(40, 2);
        state(&settings, Isa::detect(), Patience::WINDOW as usize, 2, |learner, [actor, critics], draws| {
            let (helper, occupied) = (learner.helper().unwrap(), std::sync::Barrier::new(2));
            let occupy = || {
                occupied.wait();
                std::thread::sleep(Duration::from_secs(2));
            };
            std::thread::scope(|scope| {
                scope.spawn(|| helper.beside(|start| start.work(occupy)));
                occupied.wait();
                let updates = learner.update(actor, critics, draws).unwrap();
                assert!(updates.busy);
                updates.records
            })
        });
    }

    #[test]
    fn an_exhausted_patience_leaves_one_thread_with_the_same_bits_and_is_told() {
        let settings = settings(40, 2);
        let made = |exhausted: bool| {
            state(&settings, Isa::detect(), 20, 2, |learner, [actor, critics], draws| {
                if exhausted {
                    learner.patience.note(Patience::WINDOW, Duration::from_secs(2), Duration::from_secs(1));
                }
                let updates = learner.update(actor, critics, draws).unwrap();
                assert_eq!(updates.busy, exhausted);
                updates.records
            })
        };
        assert!(made(true) == made(false));
    }
}
