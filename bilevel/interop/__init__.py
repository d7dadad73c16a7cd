"""Export of SEs as ONNX and `torch.export` programs, and import from the paper's code."""
