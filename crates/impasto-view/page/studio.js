const scene = await (await fetch("/api/scene")).json();
document.getElementById("scene").textContent = scene.name;
