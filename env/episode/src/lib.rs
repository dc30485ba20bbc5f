//! One state machine: reset, act, observe, reward, label; and a batch of them on rayon.
