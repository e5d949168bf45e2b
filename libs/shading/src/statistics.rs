//! Counts of the work that shading did and avoided.

/// The counts of lookups, rays and structures of shading a frame, for all its cameras.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[allow(missing_docs, reason = "the names say it")]
pub struct ShadingStatistics {
    pub rays: u64,
    /// The part of `rays` that only test for occlusion.
    pub shadow_rays: u64,
    pub ray_hits_shaded: u64,
    /// The number of geometry sets that rays could have requested.
    pub ray_structures: u64,
    /// The part of `ray_structures` that was requested and built.
    pub ray_structures_built: u64,
    /// The number of ray-tracing triangles at the end.
    pub ray_triangles: u64,
    /// The bytes of the ray structures at the end, with all data that hits are shaded from.
    pub ray_bytes: u64,
    /// The number of primitive parts tessellated for rays, including those tessellated again.
    pub ray_tessellations: u64,
    /// The part of `ray_tessellations` that was evicted for others.
    pub ray_tessellations_given_up: u64,
    /// The largest number of bytes of tessellations held at once.
    pub ray_tessellation_bytes_peak: u64,
    /// The number of points whose indirect light or occlusion was sampled.
    pub light_records: u64,
    /// The number of rays of `light_records`.
    pub light_rays: u64,
    /// The number of grid points that took indirect light or occlusion from records.
    pub light_points: u64,
    pub texture_files: u64,
    /// The number of files that were not MIP maps.
    pub texture_automipmaps: u64,
    pub texture_lookups: u64,
    /// The number of tiles that threads requested from the cache because they did not hold them.
    pub texture_tile_requests: u64,
    /// The part of `texture_tile_requests` that the cache did not hold either.
    pub texture_tiles_read: u64,
    pub texture_bytes_read: u64,
    /// The largest number of bytes of tiles held at once.
    pub texture_bytes_peak: u64,
}

impl ShadingStatistics {
    /// Returns all counts by the names of the fields, for programs.
    pub fn counts(&self) -> [(&'static str, u64); 20] {
        [
            ("rays", self.rays),
            ("shadow_rays", self.shadow_rays),
            ("ray_hits_shaded", self.ray_hits_shaded),
            ("ray_structures", self.ray_structures),
            ("ray_structures_built", self.ray_structures_built),
            ("ray_triangles", self.ray_triangles),
            ("ray_bytes", self.ray_bytes),
            ("ray_tessellations", self.ray_tessellations),
            ("ray_tessellations_given_up", self.ray_tessellations_given_up),
            ("ray_tessellation_bytes_peak", self.ray_tessellation_bytes_peak),
            ("light_records", self.light_records),
            ("light_rays", self.light_rays),
            ("light_points", self.light_points),
            ("texture_files", self.texture_files),
            ("texture_automipmaps", self.texture_automipmaps),
            ("texture_lookups", self.texture_lookups),
            ("texture_tile_requests", self.texture_tile_requests),
            ("texture_tiles_read", self.texture_tiles_read),
            ("texture_bytes_read", self.texture_bytes_read),
            ("texture_bytes_peak", self.texture_bytes_peak),
        ]
    }

    /// Returns a table for people, without a final line break.
    pub fn report(&self) -> String {
        let kb = |bytes: u64| bytes / 1024;
        let rows = [
            ("rays", self.rays.to_string()),
            ("  shadow rays", self.shadow_rays.to_string()),
            ("  hits shaded", self.ray_hits_shaded.to_string()),
            (
                "  structures built",
                format!(
                    "{} of {} ({} triangles, {} KB)",
                    self.ray_structures_built,
                    self.ray_structures,
                    self.ray_triangles,
                    kb(self.ray_bytes)
                ),
            ),
            (
                "  tessellations made",
                format!(
                    "{} ({} evicted, at most {} KB at once)",
                    self.ray_tessellations,
                    self.ray_tessellations_given_up,
                    kb(self.ray_tessellation_bytes_peak)
                ),
            ),
            (
                "indirect light, occlusion",
                format!(
                    "{} records of {} rays for {} points",
                    self.light_records, self.light_rays, self.light_points
                ),
            ),
            (
                "texture files",
                format!("{} ({} made into MIP maps)", self.texture_files, self.texture_automipmaps),
            ),
            ("  lookups", self.texture_lookups.to_string()),
            (
                "  tiles requested",
                format!(
                    "{}, {} not in the cache and read ({} KB, at most {} KB at once)",
                    self.texture_tile_requests,
                    self.texture_tiles_read,
                    kb(self.texture_bytes_read),
                    kb(self.texture_bytes_peak)
                ),
            ),
        ];
        rows.iter().map(|(what, value)| format!("  {what:<34} {value}")).collect::<Vec<_>>().join("\n")
    }
}
