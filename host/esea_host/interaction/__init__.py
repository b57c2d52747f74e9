"""Interaction quality: is motion through one compliant element smoother, and felt as better?"""
