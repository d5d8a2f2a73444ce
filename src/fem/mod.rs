//! How a membrane is simulated: finite elements on the prestretched configuration.
