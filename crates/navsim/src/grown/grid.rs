//! Nodes in rows and columns.

/// Rings of nodes along the border of a grid that are never entered: the second-order stencil of fast
/// marching reads two nodes away.
pub(crate) const BORDER: usize = 2;

/// Square grid of nodes: node (column, row) lies at `origin + cell * (column, row)` and has index `row * columns +
/// column`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Grid {
    /// Position of the first node, m.
    pub origin: [f64; 2],
    /// Distance between neighbouring nodes, m, > 0.
    pub cell: f64,
    /// Nodes along x.
    pub columns: usize,
    /// Nodes along y.
    pub rows: usize,
}

impl Grid {
    /// The grid with this cell size (m, > 0) whose inner nodes (those not in the border) surround `bounds`
    /// ([x0, y0, x1, y1], m, finite).
    pub fn around(bounds: [f64; 4], cell: f64) -> Self {
        let [x0, y0, x1, y1] = bounds;
        let nodes = |extent: f64| (extent / cell).ceil() as usize + 2 + 2 * BORDER;
        let margin = (0.5 + BORDER as f64) * cell;
        Self { origin: [x0 - margin, y0 - margin], cell, columns: nodes(x1 - x0), rows: nodes(y1 - y0) }
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.columns * self.rows
    }

    /// Position (m) of the node with this index.
    pub fn position(&self, node: usize) -> [f64; 2] {
        let (column, row) = (node % self.columns, node / self.columns);
        [self.origin[0] + self.cell * column as f64, self.origin[1] + self.cell * row as f64]
    }

    /// The node at the lower left of `point` (m), which must lie within the grid.
    pub fn below(&self, point: [f64; 2]) -> usize {
        let index = |at: f64, origin: f64| ((at - origin) / self.cell) as usize;
        index(point[1], self.origin[1]) * self.columns + index(point[0], self.origin[0])
    }

    /// The nodes within the axis-parallel rectangle `bounds` ([x0, y0, x1, y1], m), cut to the grid: columns and rows.
    pub fn window(&self, bounds: [f64; 4]) -> [std::ops::Range<usize>; 2] {
        let range = |low: f64, high: f64, origin: f64, count: usize| {
            let from = ((low - origin) / self.cell).ceil().max(0.0) as usize;
            let to = ((high - origin) / self.cell).floor() + 1.0;
            from..(to.max(0.0) as usize).min(count)
        };
        [
            range(bounds[0], bounds[2], self.origin[0], self.columns),
            range(bounds[1], bounds[3], self.origin[1], self.rows),
        ]
    }
}
