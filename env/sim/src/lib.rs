//! One world on rapier: table, object, hand; contacts, tactile, snapshots.
