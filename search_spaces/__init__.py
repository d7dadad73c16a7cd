"""Search spaces of BOHB, in ConfigSpace.

ConfigSpace takes a second to import. Only modules that build or sample a space import it; trials
only translate configurations to hyperparameters.
"""

#: Spaces by name, each with the recipe whose update rule its ranges of step sizes suit. The paper's
#: ranges were searched with its authors' code, which takes shorter steps than Algorithm 1.
SPACES = {"full": "authors", "core": "default"}
