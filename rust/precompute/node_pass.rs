//! The direct pass at nodes: a node's row is the mean over the points of its cell, so that the edge of a lit patch that
//! runs through a cell is neither missed nor made too much of.

use std::ops::Range;
use std::sync::Arc;

use crate::basis::ColumnSpace;
use crate::error::Result;
use crate::scene::rays::Tracer;
use crate::scene::{CELL, Placed};
use crate::transport::{GROUP, Rows16};

use super::direct::{DirectPass, Room as DirectRoom};
use super::pass::{BUNDLE_ROWS, Made, Pass, Rays, Shape, Take};

// The cells of 16 nodes make one bundle.
const _: () = assert!(CELL * GROUP == BUNDLE_ROWS);

/// Light that arrives directly at the nodes of a scene.
pub struct NodePass {
    direct: DirectPass,
    shape: Shape,
}

/// Room for one bundle and the mean of its groups.
pub struct Room {
    direct: DirectRoom,
    mean: Vec<Rows16>,
}

impl NodePass {
    /// Refuses what the direct pass does.
    pub fn new(tracer: Arc<Tracer>, placed: &Placed, space: ColumnSpace, edge_side: usize) -> Result<Self> {
        let direct = DirectPass::new(tracer, placed.cell_points(GROUP), Arc::default(), space, edge_side)?;
        let shape = Shape { rows: placed.nodes.len(), ..direct.shape().clone() };
        Ok(NodePass { direct, shape })
    }
}

impl Pass for NodePass {
    type Room = Room;

    fn shape(&self) -> &Shape {
        &self.shape
    }

    fn room(&self) -> Room {
        Room { direct: self.direct.room(), mean: vec![[0.0; GROUP]; self.shape.bands.stored()] }
    }

    fn bundle(&self, rows: Range<usize>, room: &mut Room, take: &mut Take) -> Result<Made> {
        let mut rays = Rays::default();
        for group in rows.start / GROUP..rows.end.div_ceil(GROUP) {
            room.mean.fill([0.0; GROUP]);
            let points = group * BUNDLE_ROWS..(group + 1) * BUNDLE_ROWS;
            let mean = &mut room.mean;
            let made = self.direct.bundle(points, &mut room.direct, &mut |_, planes, _| {
                for (sum, own) in mean.iter_mut().zip(planes[0]) {
                    (0..GROUP).for_each(|lane| sum[lane] += own[lane] * (1.0 / CELL as f32));
                }
                Ok(())
            })?;
            rays = rays.plus(made.rays);
            // Lanes beyond the last node are those of its stand-in.
            for lane in rows.end.min((group + 1) * GROUP) - group * GROUP..GROUP {
                room.mean.iter_mut().for_each(|row| row[lane] = 0.0);
            }
            take(0, &[&room.mean], 0.0)?;
        }
        Ok(Made { rays, seen: None })
    }
}
