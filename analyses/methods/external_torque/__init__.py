"""The wrench from external joint torque that the arm itself reports, against a sensor."""
