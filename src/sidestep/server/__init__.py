"""The HTTP API and the map page: asks what the packages below answer, and decides nothing itself."""
