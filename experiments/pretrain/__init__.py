"""What pre-training on SceneX saves: nets fine-tuned on ever more of the real reward images."""
