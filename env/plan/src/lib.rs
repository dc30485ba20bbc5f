//! Planning is purely geometric: boxes, candidate poses, collision filter, ranking. No dynamics here.
