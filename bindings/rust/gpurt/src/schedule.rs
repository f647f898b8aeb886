//! How a CUDA device goes about its work.
use crate::{sys, Compaction, Fetch, Generation, Launch, Result, Shading, Traversal};

/// How a CUDA device goes about its work; every schedule gives the same bits. By default, what measures best.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Schedule {
    /// The way through the tree.
    pub traversal: Traversal,
    /// How many threads there are.
    pub launch: Launch,
    /// Who loads triangles.
    pub fetch: Fetch,
    /// How the rays that are there are moved together.
    pub compaction: Compaction,
    /// In which order hits are shaded.
    pub shading: Shading,
    /// How shading makes rays.
    pub generation: Generation,
    /// With [`Generation::Counted`], rays that may be made at once; 0: what memory holds.
    pub ray_budget: u64,
}

impl Default for Schedule {
    fn default() -> Self {
        Schedule {
            traversal: Traversal::Auto,
            launch: Launch::Auto,
            fetch: Fetch::Auto,
            compaction: Compaction::Auto,
            shading: Shading::Auto,
            generation: Generation::Auto,
            ray_budget: 0,
        }
    }
}

impl Schedule {
    pub(crate) fn raw(&self) -> sys::gpurt_schedule {
        sys::gpurt_schedule {
            traversal: self.traversal as u32,
            launch: self.launch as u32,
            fetch: self.fetch as u32,
            compaction: self.compaction as u32,
            shading: self.shading as u32,
            generation: self.generation as u32,
            reserved: [0; 2],
            ray_budget: self.ray_budget,
        }
    }

    pub(crate) fn from_raw(raw: &sys::gpurt_schedule) -> Result<Self> {
        Ok(Schedule {
            traversal: Traversal::from_raw(raw.traversal)?,
            launch: Launch::from_raw(raw.launch)?,
            fetch: Fetch::from_raw(raw.fetch)?,
            compaction: Compaction::from_raw(raw.compaction)?,
            shading: Shading::from_raw(raw.shading)?,
            generation: Generation::from_raw(raw.generation)?,
            ray_budget: raw.ray_budget,
        })
    }
}

filled_struct! {
    /// What schedules did.
    ScheduleCounters: gpurt_schedule_counters as raw {
        same {
            /// Times that a warp drew rays from the pool.
            ray_refills: u64,
            /// Times that both kernels of leaf lists ran.
            list_rounds: u64,
            /// Lists that were full with leaves left to select.
            list_overflows: u64,
            /// Times that a warp of an uber-kernel turned to other work.
            mode_switches: u64,
            /// Warps of rays that traversed together.
            packets: u64,
            /// Triangles that a packet loaded once for all of its rays.
            shared_triangles: u64,
            /// Queues that were compacted, but for those that blocks are counted of.
            compactions: u64,
            /// Hits that were sorted by material.
            sorted_hits: u64,
            /// Rays that were counted, and then made.
            counted_rays: u64,
            /// Times that a count was over the budget.
            wave_splits: u64,
            /// Paths that started in the place of ones that had ended.
            path_refills: u64,
            /// Steps of traversal as warps took them, where lanes are counted.
            warp_steps: u64,
            /// The same as lanes took them.
            lane_steps: u64,
        }
        converted {}
    }
}
