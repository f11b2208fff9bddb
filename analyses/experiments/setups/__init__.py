"""What several experiments share: the arms, runs and recordings that they measure on."""
