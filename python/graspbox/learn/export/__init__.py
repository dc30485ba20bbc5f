"""Export of trained networks as published policies: one ONNX file for each network."""
