"""Policies for machines without this program: as a C file, and as ONNX."""
