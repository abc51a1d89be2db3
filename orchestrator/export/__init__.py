"""What leaves rotordx for other people's tools: diagnosers as C for firmware."""
