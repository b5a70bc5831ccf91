//! The acoustic modem between robots.
