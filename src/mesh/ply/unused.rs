//! Elements that are in a file but not used.

use super::header::Element;
use super::row::{Row, RowResult};
use super::table::RowConsumer;

/// Checks the rows of an element that is not used, without storing them.
pub struct UnusedElement<'a>(pub &'a Element);

impl RowConsumer for UnusedElement<'_> {
    fn take<R: Row>(&mut self, values: &mut R, _: u64) -> RowResult<()> {
        self.0.properties.iter().try_for_each(|property| values.skip_property(property.shape))
    }
}
