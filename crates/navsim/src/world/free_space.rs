//! Where a disc can go: which cells of a grid its centre may take, which hang together, and a flood fill over whole
//! words of cells.
//!
//! The grid is conservative: a cell is free when the clearance of its centre is at least `rolling_clearance`, and its
//! eight neighbours are joined to it. What is lost are passages little wider than the disc.

use super::distance::{Solid, Solids};
use super::grid::{Cell, Grid};
use super::shapes::rectangle_around;

/// Side of a cell in units of R; a straight passage along the grid is never lost if it is wider than 2.31 R.
const CELL: f64 = 0.27;
/// Side of a cell of the grid that is asked first: it finds nearly every way, in a quarter of the time, and a room of
/// 10 m then fits into one word a row for a robot of 0.25 m.
const COARSE_CELL: f64 = 0.53;

/// Clearance rho = sqrt(R^2 + h^2/2) (m) of a grid's nodes, `cell` h (m) apart, that lets a disc of `radius` R (m) roll
/// from node to node and touch nothing, however thin.
///
/// It rolls along the straight line between any two neighbours, diagonal ones too, and anywhere within a square of four
/// such nodes: with weights w_i that sum to 1, c = sum w_i c_i and an obstacle point k,
/// |c - k|^2 = sum w_i |c_i - k|^2 - sum w_i |c_i - c|^2 >= rho^2 - h^2/2 = R^2, as the c_i lie in a square of the side
/// h.
pub(crate) fn rolling_clearance(radius: f64, cell: f64) -> f64 {
    (radius * radius + 0.5 * cell * cell).sqrt()
}

/// The static free space of a world.
#[derive(Debug, Clone)]
pub(crate) struct FreeSpace {
    coarse: Level,
    fine: Level,
    /// Cells of the fine grid that hang together and cover most of the area.
    largest: Vec<u64>,
}

/// A grid and its free cells.
#[derive(Debug, Clone)]
struct Level {
    grid: Grid,
    /// Clearance of the centre that makes a cell free, m.
    inflation: f64,
    free: Vec<u64>,
}

impl FreeSpace {
    /// Looks where a disc of `radius` (m) can go among `solids` within `bounds`, and keeps the connected part that
    /// covers most of `area` (both [x0, y0, x1, y1]).
    pub fn new(bounds: [f64; 4], area: [f64; 4], solids: &Solids, radius: f64) -> Self {
        let fine = Level::new(bounds, solids, radius, CELL * radius);
        let coarse = Level::new(bounds, solids, radius, COARSE_CELL * radius);
        let largest = largest_component(&fine.grid, &fine.free, area);
        Self { coarse, fine, largest }
    }

    /// Share of the free cells in `area` that cannot be reached from the kept part, in [0, 1].
    pub fn cut_off(&self, area: [f64; 4]) -> f64 {
        let grid = &self.fine.grid;
        let count = |cells| self.centers(area).filter(|center| grid.is_set(cells, grid.cell_at(*center))).count();
        let (free, kept) = (count(&self.fine.free), count(&self.largest));
        (free - kept) as f64 / free.max(1) as f64
    }

    /// Clearance (m) that a point must have to be joined to the grids: rho of the fine one.
    pub fn clearance_needed(&self) -> f64 {
        self.fine.inflation
    }

    /// The centre of every cell within `area`.
    pub fn centers(&self, area: [f64; 4]) -> impl Iterator<Item = [f64; 2]> {
        let grid = &self.fine.grid;
        let (low, high) = (grid.cell_at([area[0], area[1]]), grid.cell_at([area[2], area[3]]));
        (low.1..=high.1).flat_map(move |row| (low.0..=high.0).map(move |column| grid.center((column, row))))
    }

    /// Whether `point`, of sufficient clearance, belongs to the kept part; `false` also for a few points that do.
    pub fn contains(&self, point: [f64; 2]) -> bool {
        anchor(&self.fine.grid, &self.largest, point, self.squared_reach()).is_some()
    }

    /// Whether two points of sufficient clearance hang together among the static and the `moved` shapes; `false` also
    /// where only a passage little wider than the disc joins them.
    pub fn joins(&self, from: [f64; 2], to: [f64; 2], moved: &[Solid], search: &mut Search) -> bool {
        [&self.coarse, &self.fine].into_iter().any(|level| {
            search.free.clone_from(&level.free);
            for solid in moved {
                level.grid.block(&mut search.free, solid, level.inflation, false);
            }
            let anchored = |point| anchor(&level.grid, &search.free, point, self.squared_reach());
            match (anchored(from), anchored(to)) {
                (Some(from), Some(to)) => search.joins(&level.grid, from, to),
                _ => false,
            }
        })
    }

    /// Memory that is large enough for any search here.
    pub fn search(&self) -> Search {
        let words = || vec![0; self.coarse.free.len().max(self.fine.free.len())];
        Search { free: words(), reached: words() }
    }

    /// Squared distance (m^2) within which a disc rolls from a point of sufficient clearance to the centre of a free
    /// cell of either grid: both have at least the clearance rho of the fine grid, so sqrt(2) h of the fine grid.
    fn squared_reach(&self) -> f64 {
        2.0 * self.fine.grid.cell * self.fine.grid.cell
    }
}

impl Level {
    fn new(bounds: [f64; 4], solids: &Solids, radius: f64, cell: f64) -> Self {
        let grid = Grid::new(bounds, cell);
        let inflation = rolling_clearance(radius, grid.cell);
        let mut free = grid.all();
        for solid in &solids.all {
            grid.block(&mut free, solid, inflation, true);
        }
        Self { grid, inflation, free }
    }
}

/// The free cell that holds `point`, or one beside it, with its centre within the squared distance (m^2) given.
fn anchor(grid: &Grid, free: &[u64], point: [f64; 2], squared_reach: f64) -> Option<Cell> {
    let home = grid.cell_at(point);
    let is_near = |cell: Cell| {
        let [x, y] = grid.center(cell);
        let (dx, dy) = (x - point[0], y - point[1]);
        grid.is_set(free, cell) && dx * dx + dy * dy <= squared_reach
    };
    if is_near(home) {
        return Some(home);
    }
    let (columns, rows) = (home.0.saturating_sub(1)..=home.0 + 1, home.1.saturating_sub(1)..=home.1 + 1);
    rows.filter(|row| *row < grid.rows)
        .flat_map(|row| columns.clone().filter(|column| *column < grid.columns).map(move |column| (column, row)))
        .find(|cell| is_near(*cell))
}

/// Whether a robot gets from one pose to another, as far as a grid can tell: `false` only where even a disc of the
/// `inner` radius (inside the footprint) cannot; `true` once a disc of the `outer` radius (around it) certainly can, or
/// where the finest grid cannot decide. Both points must have the clearance that the robot needs.
pub(crate) fn is_reachable(solids: &Solids, from: [f64; 2], to: [f64; 2], inner: f64, outer: f64) -> bool {
    let is_clear = |a, b| !solids.touches(&Solid::capsule(a, b, outer), 0.0);
    if is_clear(from, to) {
        return true;
    }
    let bounds = roomy_bounds(solids, &[from, to], outer);
    let mut search = Search::default();
    for cell in [CELL * inner, 0.5 * CELL * inner, 0.25 * CELL * inner] {
        let Level { grid, free, .. } = Level::new(bounds, solids, outer, cell);
        let rolls_to = |cell: &Cell, point| grid.is_set(&free, *cell) && is_clear(point, grid.center(*cell));
        let (start, end) = (grid.cell_at(from), grid.cell_at(to));
        if rolls_to(&start, from) && rolls_to(&end, to) {
            search.free = free;
            if search.joins(&grid, start, end) {
                return true;
            }
        }
        // A cell that holds any point of sufficient clearance has a centre with this much: a way of the robot runs
        // through such cells only, from neighbour to neighbour.
        let mut possible = grid.all();
        let certain = inner - std::f64::consts::FRAC_1_SQRT_2 * grid.cell - 1e-6;
        for solid in solids.all.iter().filter(|_| certain > 0.0) {
            grid.block(&mut possible, solid, certain, true);
        }
        search.free = possible;
        if !search.joins(&grid, start, end) {
            return false;
        }
    }
    true
}

/// A rectangle around all shapes and points with room for a disc of `radius` to drive around everything.
pub(crate) fn roomy_bounds(solids: &Solids, points: &[[f64; 2]], radius: f64) -> [f64; 4] {
    let reaches = solids.all.iter().map(|solid| (solid.center, solid.reach)).chain(points.iter().map(|p| (*p, 0.0)));
    let [x0, y0, x1, y1] =
        rectangle_around(reaches.map(|([x, y], reach)| [x - reach, y - reach, x + reach, y + reach]));
    // Twice the radius and a few cells, which are no larger than a radius unless the world is huge.
    let room = 4.0 * radius + 0.01 * (x1 - x0).max(y1 - y0);
    [x0 - room, y0 - room, x1 + room, y1 + room]
}

/// The free cells of the connected part that has most cells in `area`; the lowest one of several.
fn largest_component(grid: &Grid, free: &[u64], area: [f64; 4]) -> Vec<u64> {
    let (low, high) = (grid.cell_at([area[0], area[1]]), grid.cell_at([area[2], area[3]]));
    let runs = runs_of(grid, free);
    let mut parent: Vec<usize> = (0..runs.len()).collect();
    let mut below = 0;
    for (i, run) in runs.iter().enumerate() {
        while runs[below].row + 1 < run.row {
            below += 1;
        }
        let touching = |other: &Run| other.row < run.row && other.first < run.end + 1;
        for j in (below..i).take_while(|j| touching(&runs[*j])).filter(|j| runs[*j].end + 1 > run.first) {
            let (a, b) = (root(&mut parent, i), root(&mut parent, j));
            parent[a.max(b)] = a.min(b);
        }
    }
    let mut weights = vec![0; runs.len()];
    for (i, run) in runs.iter().enumerate() {
        if (low.1..=high.1).contains(&run.row) {
            weights[root(&mut parent, i)] += (run.end.min(high.0 + 1)).saturating_sub(run.first.max(low.0));
        }
    }
    let mut kept = vec![0; free.len()];
    // The first of equal weights: `max_by_key` would take the last.
    let Some(best) = (0..runs.len()).rev().max_by_key(|i| weights[*i]).filter(|i| weights[*i] > 0) else {
        return kept;
    };
    for (i, run) in runs.iter().enumerate() {
        if root(&mut parent, i) == best {
            for column in run.first..run.end {
                kept[run.row * grid.words + column / 64] |= 1 << (column % 64);
            }
        }
    }
    kept
}

/// Neighbouring free cells of one row, from column `first` to before `end`.
struct Run {
    row: usize,
    first: usize,
    end: usize,
}

fn runs_of(grid: &Grid, free: &[u64]) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    for row in 0..grid.rows {
        for column in (0..grid.columns).filter(|column| grid.is_set(free, (*column, row))) {
            match runs.last_mut() {
                Some(run) if run.row == row && run.end == column => run.end += 1,
                _ => runs.push(Run { row, first: column, end: column + 1 }),
            }
        }
    }
    runs
}

fn root(parent: &mut [usize], mut i: usize) -> usize {
    while parent[i] != i {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    i
}

/// Working memory of a search, reused from one to the next.
#[derive(Debug, Clone, Default)]
pub(crate) struct Search {
    free: Vec<u64>,
    reached: Vec<u64>,
}

impl Search {
    /// Whether free cells join `from` and `to`, both of which are free.
    fn joins(&mut self, grid: &Grid, from: Cell, to: Cell) -> bool {
        let (words, rows) = (grid.words, grid.rows);
        self.reached.clear();
        self.reached.resize(rows * words, 0);
        self.reached[from.1 * words + from.0 / 64] = 1 << (from.0 % 64);
        spread(&self.free[from.1 * words..][..words], &mut self.reached[from.1 * words..][..words]);
        // Rows that have been reached so far.
        let (mut low, mut high) = (from.1, from.1);
        loop {
            let mut changed = false;
            for row in low + 1..rows {
                let grown = self.grow(words, row - 1, row);
                changed |= grown;
                if row > high {
                    if !grown {
                        break;
                    }
                    high = row;
                }
            }
            for row in (0..high).rev() {
                let grown = self.grow(words, row + 1, row);
                changed |= grown;
                if row < low {
                    if !grown {
                        break;
                    }
                    low = row;
                }
            }
            if grid.is_set(&self.reached, to) {
                return true;
            }
            if !changed {
                return false;
            }
        }
    }

    /// Carries what is reached in row `source` over to its neighbour `target`; false if that adds nothing.
    fn grow(&mut self, words: usize, source: usize, target: usize) -> bool {
        let free = &self.free[target * words..][..words];
        let mut grown = false;
        for word in 0..words {
            let row = &self.reached[source * words..][..words];
            let from_left = if word > 0 { row[word - 1] >> 63 } else { 0 };
            let from_right = if word + 1 < words { row[word + 1] << 63 } else { 0 };
            let near = row[word] | row[word] << 1 | row[word] >> 1 | from_left | from_right;
            let old = self.reached[target * words + word];
            let new = old | near & free[word];
            grown |= new != old;
            self.reached[target * words + word] = new;
        }
        if grown {
            spread(free, &mut self.reached[target * words..][..words]);
        }
        grown
    }
}

/// Fills every run of free bits in a row that holds a seed.
fn spread(free: &[u64], seeds: &mut [u64]) {
    // To higher bits: adding a seed to its run carries through to the run's end.
    let mut carry = false;
    for (free, seeds) in free.iter().zip(seeds.iter_mut()) {
        let (sum, first) = free.overflowing_add(*seeds);
        let (sum, second) = sum.overflowing_add(u64::from(carry));
        carry = first || second;
        *seeds |= (free ^ sum) & free;
    }
    // To lower bits: steps of doubled length.
    let mut entering = 0;
    for (free, seeds) in free.iter().zip(seeds.iter_mut()).rev() {
        let (mut run, mut filled) = (*free, *seeds | entering & free);
        for shift in [1, 2, 4, 8, 16, 32] {
            filled |= run & (filled >> shift);
            run &= run >> shift;
        }
        *seeds = filled;
        entering = filled << 63;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Purpose, Split, Stream, StreamName};
    use crate::world::shapes::Shape;

    /// Random cells, 43 % of them free, on a grid whose rows end within a word.
    fn random_cells(seed: u64) -> (Grid, Vec<u64>) {
        let grid = Grid::new([0.0, 0.0, 150.0, 40.0], 1.0);
        let mut stream = Stream::new(StreamName::new(seed, Purpose::World, Split::Train, 0, 0));
        let mut free = grid.all();
        for row in 0..grid.rows {
            for column in 0..grid.columns {
                if stream.unit() < 0.57 {
                    free[row * grid.words + column / 64] &= !(1 << (column % 64));
                }
            }
        }
        (grid, free)
    }

    /// The cells that hang together with `from`, one by one.
    fn reached_from(grid: &Grid, free: &[u64], from: Cell) -> Vec<Cell> {
        let (mut reached, mut next) = (vec![from], 0);
        while let Some((column, row)) = reached.get(next).copied() {
            next += 1;
            for row in row.saturating_sub(1)..(row + 2).min(grid.rows) {
                for column in column.saturating_sub(1)..(column + 2).min(grid.columns) {
                    if grid.is_set(free, (column, row)) && !reached.contains(&(column, row)) {
                        reached.push((column, row));
                    }
                }
            }
        }
        reached
    }

    #[test]
    fn words_and_single_cells_find_the_same_ways() {
        for seed in 0..10 {
            let (grid, free) = random_cells(seed);
            let largest = largest_component(&grid, &free, [0.0, 0.0, 150.0, 40.0]);
            let cells = |bits: &[u64]| {
                let all = (0..grid.rows).flat_map(|row| (0..grid.columns).map(move |column| (column, row)));
                all.filter(|cell| grid.is_set(bits, *cell)).collect::<Vec<_>>()
            };
            let (all, kept) = (cells(&free), cells(&largest));
            let mut search = Search { free: free.clone(), reached: Vec::new() };
            let from = all[all.len() / 2];
            let reached = reached_from(&grid, &free, from);
            for to in all.iter().step_by(7) {
                assert_eq!(search.joins(&grid, from, *to), reached.contains(to), "{seed}: {from:?} {to:?}");
            }
            assert!(kept.len() >= reached.len());
            let mut component = reached_from(&grid, &free, kept[0]);
            component.sort_by_key(|(column, row)| (*row, *column));
            assert_eq!(component, kept);
        }
    }

    #[test]
    fn shapes_clear_exactly_the_cells_that_are_too_near() {
        let grid = Grid::new([-5.0, -5.0, 5.0, 5.0], 0.07);
        for shape in [
            Shape::Circle { center: [0.3, -0.2], radius: 0.7 },
            Shape::Box { center: [1.0, 4.0], yaw: 0.4, length: 3.0, width: 0.5 },
            Shape::Box { center: [-4.8, 0.0], yaw: 0.0, length: 1.0, width: 1.0 },
            Shape::Segment { a: [-3.0, -4.0], b: [4.0, -4.0] },
            Shape::Segment { a: [2.0, -2.0], b: [2.0, 2.0] },
            Shape::Polygon { points: vec![[-2.0, 0.0], [1.0, 0.1], [-1.0, 3.0]] },
        ] {
            let solid = Solid::new(&shape);
            for (exact, slack) in [(true, 0.0), (false, 0.083 * 0.3)] {
                let mut free = grid.all();
                grid.block(&mut free, &solid, 0.3, exact);
                for cell in (0..grid.rows).flat_map(|row| (0..grid.columns).map(move |column| (column, row))) {
                    let distance = solid.distance(grid.center(cell));
                    let is_free = grid.is_set(&free, cell);
                    assert!(!is_free || distance >= 0.3 - 1e-9, "{shape:?} {cell:?}: free at {distance}");
                    let rounded = !matches!(shape, Shape::Circle { .. } | Shape::Polygon { .. });
                    let certain = if rounded || exact { 0.3 + slack } else { f64::INFINITY };
                    assert!(is_free || distance <= certain + 1e-9, "{shape:?} {cell:?}: blocked at {distance}");
                }
            }
        }
    }
}
