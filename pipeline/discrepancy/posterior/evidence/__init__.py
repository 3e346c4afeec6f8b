"""The evidence of terms and of whole explanations on one joint."""
