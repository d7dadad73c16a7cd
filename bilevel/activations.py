"""Activation functions: codes and slopes shared by configuration, kernels and torch."""

TANH, RELU, LRELU, PRELU = 0, 1, 2, 3

#: Name -> code, in the spelling of the paper's tables (lower case).
CODES = {"tanh": TANH, "relu": RELU, "lrelu": LRELU, "prelu": PRELU}

#: Slope of LeakyReLU, and the value a PReLU starts from (torch's defaults).
LRELU_SLOPE = 0.01
PRELU_INITIAL_SLOPE = 0.25
