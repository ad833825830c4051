"""What operators see: gateway, overlay, scene, panels; the only door to viser and aiohttp."""
