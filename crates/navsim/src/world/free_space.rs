//! Where a disc can go: which cells of a grid its centre may take, which hang together, and a flood fill over whole
//! words of cells.
//!
//! The grid is conservative. Its cells have the side h; a cell is free when the clearance of its centre is at least
//! rho = sqrt(R^2 + h^2/2), and its eight neighbours are joined to it. For an obstacle point k, two free centres a, b
//! with |a - b| = d <= sqrt(2) h and a point m = (1 - t) a + t b between them,
//! |m - k|^2 = (1 - t)|a - k|^2 + t |b - k|^2 - t (1 - t) d^2 >= rho^2 - d^2/4 >= R^2: a disc of radius R rolls from
//! centre to centre and touches nothing, however thin. What is lost are passages little wider than 2 R.

use super::distance::{Solid, Solids};
use super::grid::{Cell, Grid};

/// Side of a cell in units of R; a straight passage along the grid is never lost if it is wider than 2.31 R.
const CELL: f64 = 0.27;

/// The static free space of a world.
#[derive(Debug, Clone)]
pub(crate) struct FreeSpace {
    grid: Grid,
    /// Clearance of the centre that makes a cell free, m.
    inflation: f64,
    free: Vec<u64>,
    largest: Vec<u64>,
}

impl FreeSpace {
    /// Looks where a disc of `radius` (m) can go among `solids` within `bounds`, and keeps the connected part that
    /// covers most of `area` (both [x0, y0, x1, y1]).
    pub fn new(bounds: [f64; 4], area: [f64; 4], solids: &Solids, radius: f64) -> Self {
        let (grid, inflation, free) = conservative(bounds, solids, radius, CELL * radius);
        let largest = largest_component(&grid, &free, area);
        Self { grid, inflation, free, largest }
    }

    /// Clearance (m) that a point must have to be joined to the grid.
    pub fn clearance_needed(&self) -> f64 {
        self.inflation
    }

    /// The centre of every cell within `area`.
    pub fn centers(&self, area: [f64; 4]) -> impl Iterator<Item = [f64; 2]> {
        let (low, high) = (self.grid.cell_at([area[0], area[1]]), self.grid.cell_at([area[2], area[3]]));
        (low.1..=high.1).flat_map(move |row| (low.0..=high.0).map(move |column| self.grid.center((column, row))))
    }

    /// Whether `point`, of sufficient clearance, belongs to the kept part; `false` also for a few points that do.
    pub fn contains(&self, point: [f64; 2]) -> bool {
        anchor(&self.grid, &self.largest, point).is_some()
    }

    /// Whether two points of sufficient clearance hang together among the static and the `moved` shapes; `false` also
    /// where only a passage little wider than the disc joins them.
    pub fn joins(&self, from: [f64; 2], to: [f64; 2], moved: &[Solid], search: &mut Search) -> bool {
        search.free.clone_from(&self.free);
        for solid in moved {
            self.grid.block(&mut search.free, solid, self.inflation, false);
        }
        match (anchor(&self.grid, &search.free, from), anchor(&self.grid, &search.free, to)) {
            (Some(from), Some(to)) => search.joins(&self.grid, from, to),
            _ => false,
        }
    }
}

/// The grid, the clearance that makes a cell free, and the free cells for a disc of `radius`.
fn conservative(bounds: [f64; 4], solids: &Solids, radius: f64, cell: f64) -> (Grid, f64, Vec<u64>) {
    let grid = Grid::new(bounds, cell);
    let inflation = (radius * radius + 0.5 * grid.cell * grid.cell).sqrt();
    let mut free = grid.all();
    for solid in &solids.all {
        grid.block(&mut free, solid, inflation, true);
    }
    (grid, inflation, free)
}

/// A free cell whose centre is so near to `point` that the disc rolls there if the point, too, has the clearance rho:
/// by the inequality above, within sqrt(2) h.
fn anchor(grid: &Grid, free: &[u64], point: [f64; 2]) -> Option<Cell> {
    let home = grid.cell_at(point);
    let is_near = |cell: Cell| {
        let [x, y] = grid.center(cell);
        let (dx, dy) = (x - point[0], y - point[1]);
        grid.is_set(free, cell) && dx * dx + dy * dy <= 2.0 * grid.cell * grid.cell
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
        let (grid, _, free) = conservative(bounds, solids, outer, cell);
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
    let start = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    let [x0, y0, x1, y1] = reaches.fold(start, |[x0, y0, x1, y1], ([x, y], reach)| {
        [x0.min(x - reach), y0.min(y - reach), x1.max(x + reach), y1.max(y + reach)]
    });
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
