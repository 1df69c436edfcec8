//! Tests that call the library. A few also run the program.

#[path = "../support/mod.rs"]
mod support;

/// Compares `bvh` with references that use no tree, in every instruction set, for single rays and
/// packets.
mod bvh {
    mod between;
    mod builder;
    pub mod case;
    mod contract;
    mod diagonals;
    mod grid;
    mod reference;
    mod shafts;
    mod soup;
    mod tiers;
    mod watertight;
}

/// Bodies of the fuzz targets in `fuzz/`, each with what it checks.
mod fuzz {
    mod image;
    mod inputs;
    mod job;
    mod kept;
    mod picture;
    mod ply;
    mod poses;
    mod scene;
    mod witness;
}

/// What rays hit, on every backend.
mod hits {
    mod contact;
    mod coursework_visits;
    mod instances;
    mod near;
    mod properties;
    mod spheres;
    mod stitches;
    mod terminator;
    /// Reported hits are real and exact: Embree's false hits are rejected, no ray is lost by that,
    /// and refined hits are right to the last digits.
    mod true_hits {
        mod convex;
        mod leaks;
        mod refined;
        mod setup;
        mod slivers;
    }
}

mod measure {
    mod answers;
    mod metrics;
    mod rays;
}

mod output {
    mod files;
    mod tonemap;
}

mod pictures {
    mod ambient_occlusion;
    mod cameras;
    mod catchers;
    mod closed_forms;
    mod data_layers;
    mod environment;
    mod environment_map;
    mod layers;
    mod lifted_origins;
    mod many_lights;
    mod mesh_colors;
    mod noise_bias;
    mod plate;
    mod points;
    mod sampling;
    mod sky;
    mod sun;
    mod texture_areas;
    mod texture_coordinates;
}

mod ply {
    mod attributes;
    mod bad_input;
    mod layouts;
    mod streams;
}

/// Rays and points on arrays, without a scene.
mod rays {
    mod closing;
    mod edges;
    mod limits;
    mod packets;
    mod queries;
    mod stitches;
}

mod scene {
    mod errors;
    mod fingerprint;
    mod mesh_alone;
    mod views;
    mod warnings;
    mod watched;
}
