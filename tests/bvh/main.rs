//! `bvh` against references that know nothing of trees, in every instruction-set tier, for single
//! rays and packets.

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
