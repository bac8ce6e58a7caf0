//! Named random streams: counter-based, so that a draw depends on its name and on nothing else.
//!
//! A stream is named by (seed, purpose, split, index, episode). Its numbers come from Philox4x32-10 (Salmon et al.,
//! "Parallel random numbers: as easy as 1, 2, 3", SC 2011): the seed is the key, the rest of the name and the position
//! within the stream are the counter. Streams of different names never overlap, and neither the number of threads, the
//! size of the batch nor the order of calls can change a draw.

/// What a stream is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Purpose {
    /// Start, goal and boxes of an episode.
    World = 0,
    /// Noise of the lidar.
    Noise = 1,
    /// Beams that the lidar loses.
    LostBeams = 2,
    /// Samples of a controller.
    Control = 3,
    /// Samples and ants of a planner.
    Planner = 4,
    /// Scale errors of a robot's odometry.
    Odometry = 5,
}

/// Which part of the experiment a stream belongs to; the four lists never share a world with training or each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Split {
    /// Training.
    Train = 0,
    /// The list that searches read.
    Tuning = 1,
    /// The list by which a checkpoint is chosen.
    Validation = 2,
    /// The list that a training run reports.
    Test = 3,
    /// The list that is read once, for a published table.
    Final = 4,
    /// Scenarios that the caller gave.
    Given = 5,
}

impl Split {
    /// The split of that name (`train`, `tuning`, `validation`, `test`, `final`), `None` for another word.
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "train" => Some(Self::Train),
            "tuning" => Some(Self::Tuning),
            "validation" => Some(Self::Validation),
            "test" => Some(Self::Test),
            "final" => Some(Self::Final),
            _ => None,
        }
    }
}

const ROUND_MULTIPLIERS: [u32; 2] = [0xD251_1F53, 0xCD9E_8D57];
const KEY_INCREMENTS: [u32; 2] = [0x9E37_79B9, 0xBB67_AE85];

/// One block of Philox4x32-10: four random words from a 128-bit counter and a 64-bit key.
#[inline(always)]
pub fn philox(counter: [u32; 4], key: [u32; 2]) -> [u32; 4] {
    let ([mut a, mut b, mut c, mut d], [mut k0, mut k1]) = (counter, key);
    for _ in 0..10 {
        let p0 = u64::from(a) * u64::from(ROUND_MULTIPLIERS[0]);
        let p1 = u64::from(c) * u64::from(ROUND_MULTIPLIERS[1]);
        (a, b, c, d) = ((p1 >> 32) as u32 ^ b ^ k0, p1 as u32, (p0 >> 32) as u32 ^ d ^ k1, p0 as u32);
        k0 = k0.wrapping_add(KEY_INCREMENTS[0]);
        k1 = k1.wrapping_add(KEY_INCREMENTS[1]);
    }
    [a, b, c, d]
}

/// The name of a stream; `block(i)` is its i-th block of four words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StreamName {
    key: [u32; 2],
    words: [u32; 3],
}

impl StreamName {
    /// Names a stream. `index` is the robot or scenario (below 2^32), `episode` its episode: the low 48 bits count.
    pub fn new(seed: u64, purpose: Purpose, split: Split, index: u32, episode: u64) -> Self {
        let high = (episode >> 32) as u32 & 0xFFFF;
        let tag = (purpose as u32) << 24 | (split as u32) << 16 | high;
        Self { key: [seed as u32, (seed >> 32) as u32], words: [episode as u32, index, tag] }
    }

    /// The stream of the same name for another purpose.
    pub fn with_purpose(&self, purpose: Purpose) -> Self {
        let [episode, index, tag] = self.words;
        Self { words: [episode, index, tag & 0x00FF_FFFF | (purpose as u32) << 24], ..*self }
    }

    /// The four words at `position` in this stream.
    #[inline(always)]
    pub fn block(&self, position: u32) -> [u32; 4] {
        philox([position, self.words[0], self.words[1], self.words[2]], self.key)
    }

    /// Sixteen blocks from `position` on: row k holds word k of each.
    #[inline(always)]
    pub fn sixteen_blocks(&self, position: u32) -> [[u32; LANES]; 4] {
        philox_lanes(std::array::from_fn(|i| position.wrapping_add(i as u32)), self.words, self.key)
    }
}

/// As many blocks as a vector loop takes at once.
const LANES: usize = 16;

/// `LANES` blocks from counters that differ in their first word only: row k holds word k of each.
///
/// A word lies in the lower half of a 64-bit number, where one instruction multiplies it; the upper half does not
/// matter.
#[inline(always)]
fn philox_lanes(first: [u32; LANES], rest: [u32; 3], key: [u32; 2]) -> [[u32; LANES]; 4] {
    const LOWER: u64 = 0xFFFF_FFFF;
    let (mut a, mut c) = (first.map(u64::from), [u64::from(rest[1]); LANES]);
    let (mut b, mut d) = ([u64::from(rest[0]); LANES], [u64::from(rest[2]); LANES]);
    let [mut k0, mut k1] = key;
    for _ in 0..10 {
        for i in 0..LANES {
            let p0 = (a[i] & LOWER) * u64::from(ROUND_MULTIPLIERS[0]);
            let p1 = (c[i] & LOWER) * u64::from(ROUND_MULTIPLIERS[1]);
            (a[i], b[i]) = ((p1 >> 32) ^ b[i] ^ u64::from(k0), p1);
            (c[i], d[i]) = ((p0 >> 32) ^ d[i] ^ u64::from(k1), p0);
        }
        k0 = k0.wrapping_add(KEY_INCREMENTS[0]);
        k1 = k1.wrapping_add(KEY_INCREMENTS[1]);
    }
    [a, b, c, d].map(|row| row.map(|word| word as u32))
}

/// Reads a named stream from its beginning.
#[derive(Debug, Clone)]
pub struct Stream {
    name: StreamName,
    position: u32,
    words: [u32; 4],
    used: usize,
}

impl Stream {
    /// The stream of that name, at its beginning.
    pub fn new(name: StreamName) -> Self {
        Self { name, position: 0, words: [0; 4], used: 4 }
    }

    #[inline]
    fn next_word(&mut self) -> u32 {
        if self.used == 4 {
            self.words = self.name.block(self.position);
            self.position = self.position.wrapping_add(1);
            self.used = 0;
        }
        self.used += 1;
        self.words[self.used - 1]
    }

    /// A number uniform in [0, 1), a multiple of 2^-53.
    pub fn unit(&mut self) -> f64 {
        let (high, low) = (u64::from(self.next_word()), u64::from(self.next_word()));
        ((high << 32 | low) >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// A number uniform in [low, high).
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Known answers published with the generator (Random123, kat_vectors: philox 4x32 10).
    #[test]
    fn philox_gives_the_published_words() {
        assert_eq!(philox([0; 4], [0; 2]), [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]);
        assert_eq!(philox([u32::MAX; 4], [u32::MAX; 2]), [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]);
        assert_eq!(
            philox([0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344], [0xa409_3822, 0x299f_31d0]),
            [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]
        );
    }

    #[test]
    fn sixteen_blocks_are_those_one_by_one() {
        let name = StreamName::new(u64::MAX - 5, Purpose::Noise, Split::Final, 77, 1 << 40);
        for position in [0, 1, 1000, u32::MAX - 7] {
            let words = name.sixteen_blocks(position);
            for i in 0..LANES {
                assert_eq!(words.map(|row| row[i]), name.block(position.wrapping_add(i as u32)));
            }
        }
    }

    #[test]
    fn every_part_of_the_name_matters() {
        let first = StreamName::new(1, Purpose::World, Split::Train, 3, 5).block(0);
        for other in [
            StreamName::new(2, Purpose::World, Split::Train, 3, 5),
            StreamName::new(1, Purpose::Noise, Split::Train, 3, 5),
            StreamName::new(1, Purpose::World, Split::Test, 3, 5),
            StreamName::new(1, Purpose::World, Split::Train, 4, 5),
            StreamName::new(1, Purpose::World, Split::Train, 3, 6),
            StreamName::new(1, Purpose::World, Split::Train, 3, 5 + (1 << 32)),
        ] {
            assert_ne!(first, other.block(0));
        }
        let noise = StreamName::new(1, Purpose::Noise, Split::Test, 3, 5 + (7 << 32));
        let lost = StreamName::new(1, Purpose::LostBeams, Split::Test, 3, 5 + (7 << 32));
        assert_eq!(noise.with_purpose(Purpose::LostBeams), lost);
        assert_ne!(noise, lost);
    }

    #[test]
    fn uniform_numbers_fill_their_range() {
        let mut stream = Stream::new(StreamName::new(7, Purpose::World, Split::Train, 0, 0));
        let draws: Vec<f64> = (0..100_000).map(|_| stream.uniform(-2.0, 3.0)).collect();
        let mean = draws.iter().sum::<f64>() / draws.len() as f64;
        let variance = draws.iter().map(|d| (d - mean) * (d - mean)).sum::<f64>() / draws.len() as f64;
        assert!(draws.iter().all(|d| (-2.0..3.0).contains(d)));
        // Five standard errors: sqrt(25/12 / 1e5) = 0.0046 for the mean, 0.0059 for the variance.
        assert!((mean - 0.5).abs() < 0.023, "{mean}");
        assert!((variance - 25.0 / 12.0).abs() < 0.03, "{variance}");
    }
}
