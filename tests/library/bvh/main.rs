//! Compares `bvh` with references that use no tree, in every instruction set, for single rays and
//! packets.

mod between;
mod builder;
mod case;
mod contract;
mod grid;
mod random;
mod reference;
mod soup;
mod tiers;
mod watertight;
