"""Pages and figures of studies, gallery and blind trial."""
