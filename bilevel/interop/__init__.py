"""SEs in the formats of other projects: ONNX and `torch.export` out, the paper's code in."""
