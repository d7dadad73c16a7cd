"""An evaluation of SEs: command, report and view."""
