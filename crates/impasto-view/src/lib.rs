//! The browser studio: a local server and the page that it serves.
