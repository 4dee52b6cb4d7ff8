"""What happens between Start and the finished part."""
