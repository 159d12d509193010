//! What tissue is made of: stored energy for each volume of the body at rest, stress, and tangent.
