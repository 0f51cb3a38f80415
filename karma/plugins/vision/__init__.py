"""Plug-in: perception by pictures, vision models by transformers, embedders of pictures."""
